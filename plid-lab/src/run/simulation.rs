//! Models for simulation beside PLID's: a subspace estimate as the baseline, and the model refined by output error.
//!
//! Both learn from the training data of the run and are held against the same held-out part. They take the inputs as they were measured: where preparation advanced them, because the
//! plant answers within the sample, D is estimated in the advance's place.

use nalgebra::{DMatrix, DVector};
use ndarray::{Array2, ArrayView2, Axis, concatenate, s};
use plid_model::signal::error_measures;
use plid_model::{ChannelScaling, Model, ResponseVariance, one_step_prediction, simulate, undo_scaling};
use plid_refine::{Candidate, Noise, Options, Record, RefineError, Refined, Score, Start, Uncertainty};

use super::error::RunError;
use super::validate::{Errors, Validation, offsets};
use crate::experiment::{Experiment, Refinement};
use crate::identify::{Samples, fit_predictor};
use plid_data::prepare::Prepared;
use plid_report::Progress;

/// Steps of the refinement at most. A model of the plant's own order converges well before; one that lacks something of it gains slowly and for ever.
const ITERATIONS: usize = 60;
/// Held-out errors that differ by less than this share are alike: another stretch of record would turn them round.
const ALIKE: f64 = 0.01;

/// One of them.
#[derive(Debug)]
pub struct Alternative {
    /// In the data's units, with the gain of its frozen predictor.
    pub model: Model,
    /// Free run over the held-out part of the last record (K x p, the data's units), carried on from the training part; NaN before.
    pub free_run: Array2<f64>,
    /// Errors of that.
    pub free_run_errors: Errors,
    /// One-step errors of the frozen predictor; `None` without one.
    pub one_step_errors: Option<Errors>,
}

/// How the refined model was come by.
#[derive(Debug)]
pub struct Path {
    /// Each start, refined on the first three quarters of the training data, and its free-run error on the last quarter.
    pub scores: Vec<Score>,
    /// Which of them was taken.
    pub chosen: usize,
    /// Steps of the last refinement.
    pub iterations: usize,
    /// Whether these came to their end by themselves.
    pub converged: bool,
    /// Poles that stand at the limit.
    pub poles_at_limit: usize,
    /// Covariance of its parameters, of scaled channels.
    uncertainty: Uncertainty,
    output_scales: Vec<f64>,
    input_scales: Vec<f64>,
}

impl Path {
    /// The response of the refined model with its variances, in the data's units.
    ///
    /// # Errors
    /// A frequency out of range.
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

    /// The modes of the refined model with their standard deviations.
    ///
    /// # Errors
    /// If the poles are not found.
    pub fn mode_deviations(&self, model: &Model) -> Result<Vec<plid_model::ModeDeviation>, RunError> {
        Ok(self.uncertainty.mode_deviations(model)?)
    }
}

/// All of them.
#[derive(Debug, Default)]
pub struct Simulation {
    /// The baseline; `None` where it could not be formed, which a warning says.
    pub subspace: Option<Alternative>,
    /// The refined model; `None` where it was not asked for or could not be formed.
    pub refined: Option<(Alternative, Path)>,
    /// Longest time constant that a pole of them may have, in s.
    pub longest_time_constant_s: f64,
    /// Period of the inputs in s, if they repeat in every record: what the limit was taken from.
    pub period_s: Option<f64>,
    /// What simulates the held-out part best: `plid`, `refined` or `subspace`.
    pub best: &'static str,
    /// Whether the refined model is worse than PLID's there by more than chance explains: it is then not handed over.
    pub refined_is_worse: bool,
}

/// Records as they were measured, of scaled channels: a prepared record whose inputs were advanced begins a sample later.
struct Aligned {
    inputs: Array2<f64>,
    outputs: Array2<f64>,
    training: usize,
}

fn aligned(prepared: &Prepared) -> Vec<Aligned> {
    let one = |number: usize| {
        let record = &prepared.records[number];
        let (inputs, mut outputs) = (record.inputs.clone(), record.outputs.clone());
        let mut training = prepared.training[number];
        if prepared.advanced == 1
            && let Some(last) = &prepared.last_outputs[number]
        {
            let last = Array2::from_shape_fn((1, last.len()), |(_, i)| last[i]);
            outputs = concatenate![Axis(0), outputs.slice(s![1.., ..]), last];
            training = training.saturating_sub(1);
        }
        Aligned { inputs, outputs, training }
    };
    (0..prepared.records.len()).map(one).collect()
}

/// Estimates, refines and validates; what could not be done is a warning. `scaled` is PLID's model of scaled channels.
///
/// # Errors
/// [`RunError::Refine`] with [`RefineError::Interrupted`] where the user asks for an end; a model that cannot be simulated.
pub(super) fn carry_out(
    experiment: &Experiment,
    scaled: &Model,
    prepared: &Prepared,
    validation: &Validation,
    progress: &dyn Progress,
) -> Result<(Simulation, Vec<String>), RunError> {
    let records = aligned(prepared);
    let training: Vec<Record<'_>> = records
        .iter()
        .filter(|r| r.training > 0)
        .map(|r| {
            Record { inputs: r.inputs.view(), outputs: r.outputs.view(), start: Start::Unknown }.range(0, r.training)
        })
        .collect();
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
    let bench = Bench { records: &records, prepared, validation, like: scaled };
    let mut warnings = Vec::new();

    progress.stage("subspace estimate");
    let estimate = |records: &[Record<'_>]| plid_refine::subspace(records, scaled.n(), None, rate, &options);
    match estimate(&training) {
        Ok(found) => simulation.subspace = Some(bench.judge(found.model, &found.initial_states)?),
        Err(reason) => warnings.push(format!("there is no subspace baseline: {reason}")),
    }
    if experiment.identification.refine == Refinement::OutputError {
        progress.stage("refinement");
        // A start that may decide on the last quarter must not have learnt from it.
        let of_head = plid_refine::head(&training).and_then(|head| estimate(&head));
        let mut starts = vec![Candidate { name: "plid".into(), model: scaled.clone() }];
        starts.extend(of_head.ok().map(|found| Candidate { name: "subspace".into(), model: found.model }));
        let told = |done: usize, total: usize| {
            progress.advance(done, total);
            !progress.interrupted()
        };
        match plid_refine::best_of(&starts, &training, &options, &told) {
            Err(RefineError::Interrupted) => return Err(RunError::Refine(RefineError::Interrupted)),
            Err(reason) => warnings.push(format!("there is no refined model: {reason}")),
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
        validation.free_run_errors.overall_relative,
        simulation.refined.as_ref().map(|(a, _)| error(a)),
        simulation.subspace.as_ref().map(error),
    );
    (simulation.best, simulation.refined_is_worse) = (best, worse);
    warnings.extend(said);
    Ok((simulation, warnings))
}

/// From the held-out errors of PLID's model, the refined one and the baseline: which is best, whether the refined one is worse than PLID's by more than chance explains, and
/// the warning, if it is worse at all.
fn compare(own: f64, refined: Option<f64>, subspace: Option<f64>) -> (&'static str, bool, Option<String>) {
    let candidates = [("plid", Some(own)), ("refined", refined), ("subspace", subspace)];
    let finite = candidates.iter().filter_map(|(name, e)| e.filter(|e| e.is_finite()).map(|e| (*name, e)));
    let best = finite.min_by(|a, b| a.1.total_cmp(&b.1)).map_or("plid", |(name, _)| name);
    let Some(refined) = refined.filter(|refined| *refined > own) else { return (best, false, None) };
    let worse = refined > (1.0 + ALIKE) * own;
    let kept = if worse { "it is not handed over" } else { "no more than another stretch of record might turn round" };
    let said = format!(
        "refinement-worse: on the held-out part the refined model simulates worse than PLID's ({:.3} % against {:.3} %): {kept}",
        100.0 * refined,
        100.0 * own
    );
    (best, worse, Some(said))
}

/// What every model is held against.
struct Bench<'a> {
    records: &'a [Aligned],
    prepared: &'a Prepared,
    validation: &'a Validation,
    like: &'a Model,
}

impl Bench<'_> {
    /// `model` is of scaled channels, the states are those at the first samples of the training records.
    fn judge(&self, mut model: Model, states: &[DVector<f64>]) -> Result<Alternative, RunError> {
        model.inputs.clone_from(&self.like.inputs);
        model.outputs.clone_from(&self.like.outputs);
        let last = self.records.len() - 1;
        let (record, cut) = (&self.records[last], self.records[last].training);
        let rest = model.rest();
        let state = states.last().unwrap_or(&rest);
        let run = simulate(&model, record.inputs.view(), state)?.outputs;
        let samples = Samples { inputs: record.inputs.view(), outputs: record.outputs.view(), nan_is_missing: true };
        let gain = fit_predictor(&model, samples.range(0, cut)).map(|predictor| predictor.gain);
        model.predictor_gain = gain;
        let predicted = one_step_prediction(&model, record.inputs.view(), record.outputs.view(), state).ok();
        let one_step_errors = predicted.map(|p| self.errors(p.predicted.slice(s![cut.., ..]))).transpose()?;
        let free_run_errors = self.errors(run.slice(s![cut.., ..]))?;
        let scaling = ChannelScaling {
            input_mean: vec![0.0; model.m()],
            input_scale: self.prepared.input_scales.clone(),
            output_mean: vec![0.0; model.p()],
            output_scale: self.prepared.output_scales.clone(),
        };
        let model = undo_scaling(&model, &scaling)?;
        Ok(Alternative {
            model,
            free_run: self.drawn(run.slice(s![cut.., ..]), last),
            free_run_errors,
            one_step_errors,
        })
    }

    /// Errors of scaled outputs over the held-out part, in the data's units.
    fn errors(&self, found: ArrayView2<'_, f64>) -> Result<Errors, RunError> {
        let record = &self.records[self.records.len() - 1];
        let scales = ndarray::Array1::from(self.prepared.output_scales.clone());
        let measured = &record.outputs.slice(s![record.training.., ..]) * &scales;
        Ok(error_measures(measured.view(), (&found * &scales).view())?)
    }

    /// As the validation's arrays: over the whole record, with what preparation took off.
    fn drawn(&self, held: ArrayView2<'_, f64>, last: usize) -> Array2<f64> {
        let scales = ndarray::Array1::from(self.prepared.output_scales.clone());
        let whole = self.validation.measured.dim();
        let mut drawn = Array2::from_elem(whole, f64::NAN);
        drawn.slice_mut(s![whole.0 - held.nrows().., ..]).assign(&(&held * &scales));
        drawn + offsets(self.prepared, last, 0, whole.0)
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
        assert!(worse && said.unwrap().contains("not handed over"));
    }
}
