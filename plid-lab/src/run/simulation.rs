//! Models for simulation: a subspace estimate as a baseline, and the recursive model refined by the output-error
//! method.
//!
//! Both use the training data of the run and are evaluated on the same held-out data. They use the inputs as measured:
//! if preparation advanced the inputs because the plant has feedthrough, D is estimated instead.

use nalgebra::{DMatrix, DVector};
use ndarray::{Array2, ArrayView2, Axis, CowArray, Ix2, concatenate, s};
use plid_model::signal::error_measures;
use plid_model::{ChannelScaling, Model, ResponseVariance, one_step_prediction, simulate, undo_scaling};
use plid_refine::{
    Candidate, Noise, Options, Record, RefineError, Refined, Score, Start, Uncertainty, Watcher, fit_predictor,
    slower_start, subspace,
};

use super::error::RunError;
use super::validate::Errors;
use crate::experiment::{Experiment, Refinement};
use plid_data::prepare::Prepared;
use plid_data::prepare::decimate::{decimate, plan};
use plid_work::Progress;

/// Largest number of iterations of the refinement. A model of the plant's own order converges well before; a smaller
/// model improves slowly without end.
const ITERATIONS: usize = 60;
/// Held-out errors count as equal if they differ by less than this fraction, because another part of the record could
/// reverse their order.
const ALIKE: f64 = 0.01;

/// A model for simulation and its errors.
#[derive(Debug)]
pub struct Alternative {
    /// The model in the data's units, with the gain of its steady-state predictor.
    pub model: Model,
    /// Errors of the simulation of the held-out part of the last record, continued from the training part.
    pub free_run_errors: Errors,
    /// One-step errors of the steady-state predictor; `None` if there is none.
    pub one_step_errors: Option<Errors>,
}

/// How the refined model was obtained.
#[derive(Debug)]
pub struct Path {
    /// The starting models, refined on the training data without the last quarter of the last record, with their
    /// simulation errors on that quarter.
    pub scores: Vec<Score>,
    /// Index of the selected starting model.
    pub chosen: usize,
    /// Iterations of the last refinement.
    pub iterations: usize,
    /// Whether the last refinement converged.
    pub converged: bool,
    /// Number of poles at the limit of the time constant.
    pub poles_at_limit: usize,
    /// Parameter covariance of the refined model of scaled channels.
    uncertainty: Uncertainty,
    output_scales: Vec<f64>,
    input_scales: Vec<f64>,
}

impl Path {
    /// Returns the response of the refined model with its variances at frequencies in Hz, in the data's units.
    ///
    /// # Errors
    /// Returns an error for a frequency out of range.
    pub fn response_variance(&self, hz: &[f64]) -> Result<Vec<ResponseVariance>, RunError> {
        let mut all = self.uncertainty.response_variance(hz)?;
        for at in &mut all {
            let scale = DMatrix::from_fn(self.output_scales.len(), self.input_scales.len(), |i, j| {
                self.output_scales[i] / self.input_scales[j]
            });
            at.response.zip_apply(&scale, |h, s| *h *= s);
            for variance in [&mut at.real, &mut at.imaginary, &mut at.cross] {
                variance.zip_apply(&scale, |v, s| *v *= s * s);
            }
        }
        Ok(all)
    }

    /// Returns the modes of the refined model with their standard deviations.
    ///
    /// # Errors
    /// Returns an error if the eigenvalue iteration does not converge.
    pub fn mode_deviations(&self, model: &Model) -> Result<Vec<plid_model::ModeDeviation>, RunError> {
        Ok(self.uncertainty.mode_deviations(model)?)
    }
}

/// The models for simulation and their comparison.
#[derive(Debug, Default)]
pub struct Simulation {
    /// The subspace estimate; `None` if it could not be computed, in which case there is a warning.
    pub subspace: Option<Alternative>,
    /// The refined model; `None` if it was not requested or could not be computed.
    pub refined: Option<(Alternative, Path)>,
    /// Longest permissible time constant of a pole, in s.
    pub longest_time_constant_s: f64,
    /// Period of the inputs in s if they repeat in every record; it determines the limit on the time constant.
    pub period_s: Option<f64>,
    /// The model with the smallest simulation error on the held-out data: `plid`, `refined` or `subspace`.
    pub best: &'static str,
    /// Whether the refined model is significantly worse than the recursive model on the held-out data, in which case it
    /// is not written.
    pub refined_is_worse: bool,
}

/// A record as measured, with scaled channels. The inputs of a prepared record may have been advanced, in which case
/// this record starts one sample later.
pub(super) struct Aligned<'a> {
    pub inputs: ArrayView2<'a, f64>,
    pub outputs: CowArray<'a, f64, Ix2>,
    training: usize,
}

impl<'a> Aligned<'a> {
    pub fn of(prepared: &'a Prepared, number: usize) -> Self {
        let record = &prepared.records[number];
        let (inputs, mut outputs) = (record.inputs.view(), CowArray::from(&record.outputs));
        let mut training = prepared.training[number];
        if prepared.advanced == 1
            && let Some(last) = &prepared.last_outputs[number]
        {
            let last = Array2::from_shape_fn((1, last.len()), |(_, i)| last[i]);
            outputs = concatenate![Axis(0), outputs.slice(s![1.., ..]), last].into();
            training = training.saturating_sub(1);
        }
        Self { inputs, outputs, training }
    }
}

/// The training part of each record that has one.
fn training<'a>(records: &'a [Aligned<'_>]) -> Vec<Record<'a>> {
    records
        .iter()
        .filter(|r| r.training > 0)
        .map(|r| Record { inputs: r.inputs, outputs: r.outputs.view(), start: Start::Unknown }.range(0, r.training))
        .collect()
}

/// Returns the models from which the refinement starts: an estimate from all samples at once, and the recursive one.
/// The former comes first, because the latter is often far worse in free run. If the rate is `every` times as high as
/// necessary, the estimate is made at the lower rate.
///
/// # Errors
/// Returns [`RefineError::Interrupted`] if the user interrupts the run.
fn starts(
    recursive: &Model,
    training: &[Record<'_>],
    every: usize,
    options: &Options,
    watcher: Watcher<'_>,
) -> Result<Vec<Candidate>, RunError> {
    let (states, rate) = (recursive.n(), recursive.sample_rate_hz);
    // A starting model must not use the quarter of the data on which it is scored.
    let batch = plid_refine::head(training).and_then(|head| {
        let slow = if every > 1 { reduced(&head, every, rate) } else { None };
        let slower = slow.map(|slow| {
            let slow: Vec<Record<'_>> = slow.iter().map(unknown_start).collect();
            slower_start(&slow, states, every, rate, options, watcher)
        });
        match slower {
            Some(Ok(model)) => Ok(("lower rate", model)),
            Some(Err(RefineError::Interrupted)) => Err(RefineError::Interrupted),
            // There may be too few samples at the lower rate.
            Some(Err(_)) | None => Ok(("subspace", subspace(&head, states, None, rate, options)?.model)),
        }
    });
    if let Err(RefineError::Interrupted) = batch {
        return Err(RunError::Refine(RefineError::Interrupted));
    }
    let batch = batch.ok().map(|(name, model)| Candidate { name: name.into(), model });
    let recursive = Candidate { name: "plid".into(), model: recursive.clone() };
    Ok(batch.into_iter().chain([recursive]).collect())
}

/// Returns records at a rate that is lower by a factor; `None` if one is too short for the filter.
fn reduced(records: &[Record<'_>], every: usize, rate: f64) -> Option<Vec<plid_data::Record>> {
    let plan = plan(rate, rate / every as f64).ok()?;
    let whole = |record: &Record<'_>| plid_data::Record {
        sample_rate_hz: rate,
        input_names: Vec::new(),
        output_names: Vec::new(),
        inputs: record.inputs.to_owned(),
        outputs: record.outputs.to_owned(),
    };
    records.iter().enumerate().map(|(k, record)| decimate(&whole(record), &plan, k + 1).ok()).collect()
}

fn unknown_start(record: &plid_data::Record) -> Record<'_> {
    Record { inputs: record.inputs.view(), outputs: record.outputs.view(), start: Start::Unknown }
}

/// Reports the progress and returns whether to continue.
fn may_go_on(progress: &dyn Progress, done: usize, total: usize) -> bool {
    progress.advance(done, total);
    !progress.interrupted()
}

/// Estimates, refines and validates the models. A model that cannot be computed causes a warning. `scaled` is the
/// recursive model of scaled channels, and `own` has its errors in free run.
///
/// # Errors
/// Returns [`RunError::Refine`] with [`RefineError::Interrupted`] if the user interrupts the run, and an error for a
/// model that cannot be simulated.
pub(super) fn carry_out(
    experiment: &Experiment,
    scaled: &Model,
    prepared: &Prepared,
    own: &Errors,
    progress: &dyn Progress,
) -> Result<(Simulation, Vec<String>), RunError> {
    let records: Vec<Aligned> = (0..prepared.records.len()).map(|number| Aligned::of(prepared, number)).collect();
    let training = training(&records);
    let rate = scaled.sample_rate_hz;
    let options = Options {
        radius: plid_refine::slowest_radius(&training),
        feedthrough: prepared.advanced == 1,
        iterations: ITERATIONS,
        noise: Noise::White,
    };
    let periods: Option<Vec<usize>> = training.iter().map(|r| plid_refine::period(r.inputs)).collect();
    let mut simulation = Simulation {
        longest_time_constant_s: -1.0 / (options.radius.ln() * rate),
        period_s: periods.and_then(|p| p.into_iter().max()).map(|samples| samples as f64 / rate),
        best: "plid",
        ..Simulation::default()
    };
    let bench = Bench { records: &records, prepared, like: scaled };
    let mut warnings = Vec::new();

    progress.stage("subspace estimate");
    match subspace(&training, scaled.n(), None, rate, &options) {
        Ok(found) => simulation.subspace = Some(bench.judge(found.model, &found.initial_states)?),
        Err(reason) => warnings.push(format!("the subspace estimate could not be computed: {reason}")),
    }
    if experiment.identification.refine == Refinement::OutputError {
        progress.stage("refinement");
        let watcher = |done, total| may_go_on(progress, done, total);
        let starts = starts(scaled, &training, prepared.oversampled_by(), &options, &watcher)?;
        match plid_refine::best_of(&starts, &training, &options, &watcher) {
            Err(RefineError::Interrupted) => return Err(RunError::Refine(RefineError::Interrupted)),
            Err(reason) => warnings.push(format!("the refined model could not be computed: {reason}")),
            Ok(choice) => {
                let Refined { model, initial_states, iterations, converged, poles_at_limit, uncertainty, .. } =
                    choice.refined;
                let path = Path {
                    scores: choice.scores,
                    chosen: choice.chosen,
                    iterations,
                    converged,
                    poles_at_limit,
                    uncertainty,
                    output_scales: prepared.output_scales.clone(),
                    input_scales: prepared.input_scales.clone(),
                };
                simulation.refined = Some((bench.judge(model, &initial_states)?, path));
            }
        }
    }
    let error = |a: &Alternative| a.free_run_errors.overall_relative;
    let (best, worse, said) = compare(
        own.overall_relative,
        simulation.refined.as_ref().map(|(a, _)| error(a)),
        simulation.subspace.as_ref().map(error),
    );
    (simulation.best, simulation.refined_is_worse) = (best, worse);
    warnings.extend(said);
    Ok((simulation, warnings))
}

/// Compares the held-out errors of the recursive, the refined and the subspace model. Returns the best of them, whether
/// the refined model is significantly worse than the recursive one, and a warning if it is worse at all.
fn compare(own: f64, refined: Option<f64>, subspace: Option<f64>) -> (&'static str, bool, Option<String>) {
    let candidates = [("plid", Some(own)), ("refined", refined), ("subspace", subspace)];
    let finite = candidates.iter().filter_map(|(name, e)| e.filter(|e| e.is_finite()).map(|e| (*name, e)));
    let best = finite.min_by(|a, b| a.1.total_cmp(&b.1)).map_or("plid", |(name, _)| name);
    let Some(refined) = refined.filter(|refined| *refined > own) else { return (best, false, None) };
    let worse = refined > (1.0 + ALIKE) * own;
    let kept = if worse { "the refined model is not written" } else { "the difference is not significant" };
    let said = format!(
        "refinement-worse: on held-out data the refined model has a larger simulation error than the recursive model \
         ({:.3} % against {:.3} %); {kept}",
        100.0 * refined,
        100.0 * own
    );
    (best, worse, Some(said))
}

/// The data on which every model is evaluated.
struct Bench<'a> {
    records: &'a [Aligned<'a>],
    prepared: &'a Prepared,
    like: &'a Model,
}

impl Bench<'_> {
    /// Evaluates a model of scaled channels with the given states at the first samples of the training records.
    fn judge(&self, mut model: Model, states: &[DVector<f64>]) -> Result<Alternative, RunError> {
        model.inputs.clone_from(&self.like.inputs);
        model.outputs.clone_from(&self.like.outputs);
        let last = self.records.len() - 1;
        let (record, cut) = (&self.records[last], self.records[last].training);
        let rest = model.rest();
        let state = states.last().unwrap_or(&rest);
        let training = s![..cut, ..];
        let gain = fit_predictor(&model, record.inputs.slice(training), record.outputs.slice(training));
        let gain = gain.map(|predictor| predictor.gain);
        model.predictor_gain = gain;
        let predicted = one_step_prediction(&model, record.inputs, record.outputs.view(), state).ok();
        let one_step_errors = predicted.map(|p| self.errors(p.predicted.slice(s![cut.., ..]))).transpose()?;
        let run = simulate(&model, record.inputs, state)?.outputs;
        let free_run_errors = self.errors(run.slice(s![cut.., ..]))?;
        let scaling = ChannelScaling {
            input_mean: vec![0.0; model.m()],
            input_scale: self.prepared.input_scales.clone(),
            output_mean: vec![0.0; model.p()],
            output_scale: self.prepared.output_scales.clone(),
        };
        let model = undo_scaling(&model, &scaling)?;
        Ok(Alternative { model, free_run_errors, one_step_errors })
    }

    /// Returns the errors of scaled outputs over the held-out part, in the data's units.
    fn errors(&self, found: ArrayView2<'_, f64>) -> Result<Errors, RunError> {
        let record = &self.records[self.records.len() - 1];
        let measured = record.outputs.slice(s![record.training.., ..]);
        Ok(error_measures(measured, found)?.in_units(&self.prepared.output_scales))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refined_model_that_is_worse_is_named() {
        assert_eq!(compare(0.05, Some(0.04), Some(0.06)), ("refined", false, None));
        assert_eq!(compare(f64::INFINITY, Some(0.04), Some(0.03)), ("subspace", false, None));
        assert_eq!(compare(0.05, None, None), ("plid", false, None));
        let (best, worse, said) = compare(0.05, Some(0.0502), Some(0.06));
        assert!(best == "plid" && !worse && said.unwrap().contains("refinement-worse"));
        let (_, worse, said) = compare(0.05, Some(0.06), Some(0.055));
        assert!(worse && said.unwrap().contains("is not written"));
    }
}
