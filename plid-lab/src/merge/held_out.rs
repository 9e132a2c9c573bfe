//! Evaluation of the merged model on a record in which all inputs act.

use nalgebra::DVector;
use ndarray::{Array2, ArrayView2, s};
use plid_model::signal::{ErrorMeasures, error_measures};
use plid_model::{Model, estimate_initial_state, one_step_prediction, simulate};

use crate::run::RunError;
use plid_data::Record;
use plid_data::prepare::scaling::Scaling;
use plid_data::prepare::{Advance, Preparation, prepare};

/// Simulations of the held-out part of a record, in the data's units.
#[derive(Clone, Debug)]
pub struct HeldOut {
    /// The name of the record.
    pub record: String,
    /// Sample rate after preparation, in Hz.
    pub sample_rate_hz: f64,
    /// One-step prediction errors, if the model has a predictor gain.
    pub one_step_errors: Option<ErrorMeasures>,
    /// Outputs as deviations from their means (K x p).
    pub measured: Array2<f64>,
    /// The simulation from the state at the end of the leading part (K x p); infinite where it diverges.
    pub free_run: Array2<f64>,
    /// Errors of the simulation.
    pub errors: ErrorMeasures,
    /// Errors of the true plant, for simulated data.
    pub truth_errors: Option<ErrorMeasures>,
}

/// Simulates `model` (canonical, with its inputs `advanced` as in its runs) over the part of `record` after its leading
/// fraction `share`, prepared as in the runs. The leading part determines only the state at its end and the means.
pub(super) fn judge(
    model: &Model,
    advanced: usize,
    name: &str,
    records: Vec<Record>,
    share: f64,
    preparation: &Preparation,
    noise_free: Option<&Array2<f64>>,
) -> Result<HeldOut, RunError> {
    let as_runs = Preparation {
        advance: if advanced == 1 { Advance::Yes } else { Advance::No },
        scaling: Scaling::None,
        ..preparation.clone()
    };
    let shares = vec![share; records.len()];
    let prepared = prepare(records, &shares, &as_runs)?;
    let (record, training) = (&prepared.records[0], prepared.training[0]);
    if (record.sample_rate_hz - model.sample_rate_hz).abs() > 1e-4 * model.sample_rate_hz {
        let reason = format!(
            "the sample rate of {name} is {} Hz, that of the runs {} Hz",
            record.sample_rate_hz, model.sample_rate_hz
        );
        return Err(RunError::Setting { key: "file", reason });
    }
    let (head, tail) = (s![..training, ..], s![training.., ..]);
    let (inputs, measured) = (record.inputs.slice(tail), record.outputs.slice(tail).to_owned());
    let start = state_after(model, record.inputs.slice(head), record.outputs.slice(head))?;
    // A simulation that diverges is a result and not an error.
    let diverged = || Array2::from_elem(measured.dim(), f64::INFINITY);
    let free_run = simulate(model, inputs, &start).map_or_else(|_| diverged(), |run| run.outputs);
    let errors = error_measures(measured.view(), free_run.view())?;
    let one_step_errors = match &model.predictor_gain {
        None => None,
        Some(_) => {
            let predicted = one_step_prediction(model, inputs, measured.view(), &start)
                .map_or_else(|_| diverged(), |run| run.predicted);
            Some(error_measures(measured.view(), predicted.view())?)
        }
    };
    let truth_errors = match noise_free
        .filter(|noise_free| prepared.start_s == 0.0 && noise_free.nrows() == record.samples() + advanced)
    {
        None => None,
        Some(noise_free) => {
            let mut response = noise_free.slice(s![training..training + measured.nrows(), ..]).to_owned();
            for (k, mut row) in response.rows_mut().into_iter().enumerate() {
                let seconds = (training + k) as f64 / record.sample_rate_hz;
                row.iter_mut()
                    .zip(&prepared.lines[0][1])
                    .for_each(|(y, line)| *y -= line.offset + line.slope_per_s * seconds);
            }
            Some(error_measures(measured.view(), response.view())?)
        }
    };
    Ok(HeldOut {
        record: name.into(),
        sample_rate_hz: record.sample_rate_hz,
        one_step_errors,
        measured,
        free_run,
        errors,
        truth_errors,
    })
}

/// Returns the state after a segment of a record: by the predictor from rest or, without a predictor gain, by the
/// simulation that best fits the segment.
fn state_after(model: &Model, inputs: ArrayView2<f64>, outputs: ArrayView2<f64>) -> Result<DVector<f64>, RunError> {
    if model.predictor_gain.is_some()
        && let Ok(prediction) = one_step_prediction(model, inputs, outputs, &model.rest())
    {
        return Ok(prediction.final_state);
    }
    let start = estimate_initial_state(model, inputs, outputs, None)?.state;
    // If the segment cannot be simulated, the following part cannot be simulated either.
    Ok(simulate(model, inputs, &start).map_or(start, |run| run.final_state))
}
