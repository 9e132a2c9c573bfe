//! Validation of the fixed model on held-out data: one-step errors, simulation errors and residual tests.

use nalgebra::{DMatrix, DVector};
use ndarray::{Array1, Array2, ArrayView1, ArrayView2, Axis, CowArray, Ix2, concatenate, s};

use super::error::{RunError, setting};
use super::obtain::Truth;
use crate::experiment::Experiment;
use plid_data::prepare::{Prepared, Step};
use plid_model::signal::{
    Correlation, CrossCorrelationOptions, ErrorMeasures, WhitenessOptions, cross_correlation, error_measures,
    period_noise_rms, rms, whiteness,
};
use plid_model::{Model, one_step_prediction, simulate};

/// Errors of one kind on the held-out part, for outputs as deviations from their means.
pub type Errors = ErrorMeasures;

/// The validation results.
#[derive(Debug)]
pub struct Validation {
    /// Number of training samples of the last record.
    pub training: usize,
    /// Number of samples after the training samples.
    pub held_out_samples: usize,
    /// The first of these samples, at most 400, as reports draw them.
    pub shown: Shown,
    /// Innovations, one array per record; the held-out part of the last record is from the steady-state predictor.
    pub innovations: Vec<Array2<f64>>,
    /// One-step errors of the steady-state predictor; `None` if there is none.
    pub one_step_errors: Option<Errors>,
    /// Simulation errors; infinite if the model diverges.
    pub free_run_errors: Errors,
    /// Simulation errors of the true plant, for simulated data.
    pub truth_errors: Option<Errors>,
    /// Noise of each output relative to its RMS, if repeats or periods determine it.
    pub noise_floor: Option<Vec<f64>>,
    /// Whiteness tests of the held-out one-step residuals, one per output.
    pub whiteness: Vec<Correlation>,
    /// Cross-correlations of these residuals with the inputs, indexed by output and input.
    pub cross: Vec<Vec<Correlation>>,
    /// The reason why the residuals could not be tested, if any.
    pub tests_failed: Option<String>,
    /// First lag of the correlation with the inputs.
    pub first_lag: i64,
}

pub(super) fn validate(
    experiment: &Experiment,
    scaled: &Model,
    gain: Option<&DMatrix<f64>>,
    state: &[f64],
    mut innovations: Vec<Array2<f64>>,
    prepared: &Prepared,
    truth: Option<&Truth>,
) -> Result<Validation, RunError> {
    let last = prepared.records.len() - 1;
    let training = prepared.training[last];
    let scales = Array1::from(prepared.output_scales.clone());
    // Long records occupy most of the memory, so these arrays of scaled channels are changed in place.
    let HeldOut { measured, free_run, predicted } = HeldOut::run(scaled, gain, state, prepared);
    let errors = |response: ArrayView2<'_, f64>| -> Result<Errors, RunError> {
        Ok(error_measures(measured.view(), response)?.in_units(&prepared.output_scales))
    };
    let one_step_errors = predicted.as_ref().map(|predicted| errors(predicted.view())).transpose()?;
    let free_run_errors = errors(free_run.view())?;
    let truth_errors = truth.map(|truth| {
        // The true model starts at rest with the record, so no initial state is fitted.
        let from = truth.noise_free.nrows() - measured.nrows();
        let offsets = offsets(prepared, last, training, measured.nrows());
        errors(((&truth.noise_free.slice(s![from.., ..]) - &offsets) / &scales).view())
    });
    let shown = Shown {
        measured: shown(prepared, measured.view()),
        free_run: shown(prepared, free_run.view()),
        predicted: predicted.as_ref().map(|predicted| shown(prepared, predicted.view())),
    };
    drop(free_run);
    let residual = predicted.map(|mut predicted| {
        predicted.zip_mut_with(&measured, |x, y| *x = y - *x);
        predicted
    });
    let tests = ResidualTests::of(experiment, prepared, residual.as_ref().map(|residual| residual.view()));
    if let Some(own) = innovations.last_mut() {
        let residual = residual.unwrap_or_else(|| Array2::from_elem(measured.dim(), f64::NAN));
        own.append(Axis(0), residual.view()).expect("both have a column for each output");
    }
    innovations.iter_mut().for_each(|record| *record *= &scales);
    Ok(Validation {
        training,
        held_out_samples: measured.nrows(),
        innovations,
        one_step_errors,
        free_run_errors,
        truth_errors: truth_errors.transpose()?,
        noise_floor: noise_floor(experiment, prepared, measured.view())?,
        whiteness: tests.whiteness,
        cross: tests.cross,
        tests_failed: tests.failed,
        first_lag: first_lag(prepared),
        shown,
    })
}

/// Number of held-out samples that are kept for reports. Long records occupy most of the memory of a run.
const SHOWN: usize = 400;

/// The first samples of the held-out part of the last record, in the data's units (K x p).
#[derive(Debug)]
pub struct Shown {
    /// The measured outputs.
    pub measured: Array2<f64>,
    /// The simulation from the last training state; infinite if the model diverges.
    pub free_run: Array2<f64>,
    /// The one-step prediction by the steady-state predictor; `None` if there is no stable predictor.
    pub predicted: Option<Array2<f64>>,
}

/// Returns the first of the held-out samples of scaled outputs in the data's units, with the trends that preparation
/// removed.
fn shown(prepared: &Prepared, scaled: ArrayView2<'_, f64>) -> Array2<f64> {
    let last = prepared.records.len() - 1;
    let scales = Array1::from(prepared.output_scales.clone());
    let mut first = &scaled.slice(s![..SHOWN.min(scaled.nrows()), ..]) * &scales;
    add_offsets(prepared, last, prepared.training[last], &mut first);
    first
}

/// The held-out part of the last record, with scaled channels (K x p). K includes the last sample even if the input was
/// advanced.
struct HeldOut<'a> {
    measured: CowArray<'a, f64, Ix2>,
    /// The simulation; infinite if the model diverges.
    free_run: Array2<f64>,
    /// The one-step prediction; `None` if there is no stable predictor.
    predicted: Option<Array2<f64>>,
}

impl<'a> HeldOut<'a> {
    fn run(scaled: &Model, gain: Option<&DMatrix<f64>>, state: &[f64], prepared: &'a Prepared) -> Self {
        let last = prepared.records.len() - 1;
        let (record, training) = (&prepared.records[last], prepared.training[last]);
        let x0 = DVector::from_column_slice(state);
        let inputs = record.inputs.slice(s![training.., ..]);
        let outputs = record.outputs.slice(s![training.., ..]);
        // The sample that the input advance drops, as measured and as the model gives it from the state after the
        // other samples.
        let dropped = &prepared.last_outputs[last];
        let whole = |array: ArrayView2<'_, f64>, row: &[f64]| {
            concatenate![Axis(0), array, ArrayView1::from(row).insert_axis(Axis(0))]
        };
        let with_last = |array: Array2<f64>, state: &DVector<f64>| match dropped {
            Some(_) => whole(array.view(), (&scaled.c * state).as_slice()),
            None => array,
        };
        let measured = match dropped {
            Some(row) => whole(outputs, row).into(),
            None => outputs.into(),
        };
        // A simulation that diverges is a result and not an error: its error is infinite.
        let free_run = simulate(scaled, inputs, &x0).map_or_else(
            |_| Array2::from_elem(CowArray::dim(&measured), f64::INFINITY),
            |simulation| with_last(simulation.outputs, &simulation.final_state),
        );
        let predicted = gain.and_then(|gain| {
            let model = Model { predictor_gain: Some(gain.clone()), ..scaled.clone() };
            let prediction = one_step_prediction(&model, inputs, outputs, &x0).ok()?;
            Some(with_last(prediction.predicted, &prediction.final_state))
        });
        Self { measured, free_run, predicted }
    }
}

/// Returns the first lag of the correlation with the inputs.
fn first_lag(prepared: &Prepared) -> i64 {
    if prepared.advanced == 1 { 0 } else { 1 }
}

/// Largest number of held-out samples of which the residuals are tested. More would take memory and time, and show
/// errors that are too small to matter.
const TESTED: usize = 100_000;

/// Tests of the held-out one-step residuals.
#[derive(Default)]
struct ResidualTests {
    whiteness: Vec<Correlation>,
    cross: Vec<Vec<Correlation>>,
    failed: Option<String>,
}

impl ResidualTests {
    /// Tests the residuals (K x p) for whiteness, and for correlation with the inputs. Without residuals there is
    /// nothing to test.
    fn of(experiment: &Experiment, prepared: &Prepared, residual: Option<ArrayView2<'_, f64>>) -> Self {
        let Some(residual) = residual else { return Self::default() };
        let last = prepared.records.len() - 1;
        let inputs = prepared.records[last].inputs.slice(s![prepared.training[last].., ..]);
        let samples = inputs.nrows().min(TESTED);
        let (inputs, tested) = (inputs.slice_move(s![..samples, ..]), residual.slice(s![..samples, ..]));
        let lags = experiment.validation.lags.unwrap_or(50.min(residual.nrows() / 8)).max(1);
        // An advanced input at k - 1 is the input at k.
        let cross_options = CrossCorrelationOptions { first_lag: 1, last_lag: lags as i64, confidence: 0.99 };
        let tests = whiteness(tested, &WhitenessOptions { lags, ..WhitenessOptions::default() })
            .and_then(|white| Ok((white, cross_correlation(tested, inputs, &cross_options)?)));
        match tests {
            Ok((whiteness, mut cross)) => {
                let shift = 1 - first_lag(prepared);
                cross.iter_mut().flatten().for_each(|c| c.lags.iter_mut().for_each(|lag| *lag -= shift));
                Self { whiteness, cross, failed: None }
            }
            Err(reason) => Self { failed: Some(reason.to_string()), ..Self::default() },
        }
    }
}

/// Returns the offsets that preparation removed from the outputs of a record, from sample `first` on (count x p).
fn offsets(prepared: &Prepared, record: usize, first: usize, count: usize) -> Array2<f64> {
    let mut offsets = Array2::zeros((count, prepared.output_scales.len()));
    add_offsets(prepared, record, first, &mut offsets);
    offsets
}

/// Adds the offsets that preparation removed to outputs of a record, from sample `first` on, in place.
fn add_offsets(prepared: &Prepared, record: usize, first: usize, outputs: &mut Array2<f64>) {
    let rate = prepared.records[record].sample_rate_hz;
    for (mut column, line) in outputs.columns_mut().into_iter().zip(&prepared.lines[record][1]) {
        for (k, value) in column.iter_mut().enumerate() {
            *value += line.offset + line.slope_per_s * ((first + k) as f64 / rate);
        }
    }
}

/// Returns the noise of each output over its RMS, from the spread of averaged repeats or of the periods named in the
/// config. `measured` holds the scaled outputs.
fn noise_floor(
    experiment: &Experiment,
    prepared: &Prepared,
    measured: ArrayView2<'_, f64>,
) -> Result<Option<Vec<f64>>, RunError> {
    let scaled = measured.columns().into_iter().map(rms);
    let sizes: Vec<f64> = scaled.zip(&prepared.output_scales).map(|(size, scale)| size * scale).collect();
    let over = |noise: Vec<f64>| noise.iter().zip(&sizes).map(|(n, s)| n / s).collect();
    if let Some((noise, count)) = prepared.repeat_noise.first() {
        return Ok(Some(over(noise.rms().iter().map(|n| n / (*count as f64).sqrt()).collect())));
    }
    if let Some(period) = experiment.validation.period {
        let ratio = prepared.steps.iter().find_map(|step| match step {
            Step::Decimated(plan) => Some(plan.ratio),
            _ => None,
        });
        let ratio = ratio.unwrap_or(1);
        if period % ratio != 0 {
            let reason = format!("{period} samples are not a multiple of the decimation ratio {ratio}");
            return Err(setting("period", reason));
        }
        let last = prepared.records.len() - 1;
        let noise = period_noise_rms(prepared.records[last].outputs.view(), period / ratio, 1)?;
        return Ok(Some(over(noise.iter().zip(&prepared.output_scales).map(|(n, s)| n * s).collect())));
    }
    Ok(None)
}
