//! The recursion sample by sample, in volts, so that it can be observed and timed.

use std::time::Instant;

use ndarray::{Array2, ArrayView2};
use plid_catalogue::{CovarianceName, Variant};
use plid_core::{IdentifiedModel, NoiseModel, ObservableForm, Settings};
use plid_lab::identify::ToModel;
use plid_lab::run::Outcome;
use plid_model::Model;

use crate::claim::Result;

/// A record in volts: inputs K x m and outputs K x p.
pub type Pair<'a> = (ArrayView2<'a, f64>, ArrayView2<'a, f64>);

/// The course of a recursion.
pub struct Course {
    /// One-step errors (K x p) in V.
    pub innovations: Array2<f64>,
    /// The models at regular intervals, each with the number of samples processed.
    pub models: Vec<(usize, Model)>,
    /// The estimate at the end.
    pub identified: IdentifiedModel,
    /// Duration of the steps in s, without the computation of models.
    pub seconds: f64,
}

/// Returns the canonical form and the start of the paper's recursion. Nothing is known, and the channels have about 1
/// V.
///
/// # Errors
/// Returns an error for fewer states than outputs.
pub fn form_and_start(states: usize, (inputs, outputs): Pair<'_>) -> Result<(ObservableForm, Settings)> {
    let form = ObservableForm::balanced(states, outputs.ncols(), inputs.ncols())?;
    let settings = Settings::new(&form, 1.0, 1.0);
    Ok((form, settings))
}

/// Runs the recursion over a record and keeps the model after every `every` samples.
///
/// # Errors
/// Returns an error for a recursion that cannot be built or that breaks down.
pub fn course(
    (inputs, outputs): Pair<'_>,
    rate_hz: f64,
    (form, settings): &(ObservableForm, Settings),
    noise: &NoiseModel,
    every: usize,
) -> Result<Course> {
    // With forgetting, P grows in directions without information, and a P that is stored as a matrix is soon lost.
    let covariance = if settings.forgetting < 1.0 { CovarianceName::BiermanUd } else { CovarianceName::Direct };
    let mut recursion = Variant { covariance, ..Variant::default() }.build(form.clone(), noise, settings)?;
    let (mut innovations, mut models, mut seconds) = (Array2::zeros(outputs.dim()), Vec::new(), 0.0);
    let mut start = Instant::now();
    for k in 0..outputs.nrows() {
        recursion.step(&outputs.row(k).to_vec(), &inputs.row(k).to_vec(), false)?;
        innovations.row_mut(k).iter_mut().zip(recursion.innovation()).for_each(|(to, &e)| *to = e);
        if (k + 1) % every == 0 {
            seconds += start.elapsed().as_secs_f64();
            models.push((k + 1, recursion.identified().to_model(rate_hz)?));
            start = Instant::now();
        }
    }
    seconds += start.elapsed().as_secs_f64();
    Ok(Course { innovations, models, identified: recursion.identified(), seconds })
}

/// Returns the noise covariances of a run in V²; those of actuators are zero.
pub fn noise_of(outcome: &Outcome) -> NoiseModel {
    let (sensor, state) = &outcome.noise_levels;
    let scales = &outcome.prepared.output_scales;
    let sensor: Vec<f64> = sensor.iter().zip(scales).map(|(r, scale)| r * scale * scale).collect();
    let blocks = outcome.form.indices().iter().zip(scales);
    let state: Vec<f64> = blocks.flat_map(|(&count, scale)| vec![state * scale * scale; count]).collect();
    NoiseModel::diagonal(&sensor, &vec![0.0; outcome.model.m()], &state)
}
