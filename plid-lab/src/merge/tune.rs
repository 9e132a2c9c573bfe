//! One setting of the noise covariances for all runs, by the free-run error of the merged model.
//!
//! A bank for each run alone would find covariances decades apart, since a run's own free-run error hardly depends on them. The merge does: what a run
//! knows better than another one is in the shape of its P, and P is shaped by R and Sigma.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::DMatrix;
use plid_core::{Dense, NoiseModel};
use plid_model::signal::error_measures;
use plid_model::{ChannelScaling, Model, ModelError, estimate_initial_state, simulate, undo_scaling};
use rayon::prelude::*;

use super::MergeError;
use super::carry_out::of_run;
use super::merged::{Piece, join};
use crate::experiment::{Covariance, Experiment, NoiseConfig, NoiseReading, NoiseSource};
use crate::identify::{Bank, Ending, Memory, Point, Samples, Trial, fit_predictor, run, tune_by};
use crate::run::{self, Estimate, RunError, scaled_model, scaling, training};
use plid_data::prepare::Prepared;

/// The smallest R that the search begins with: 1e-4 of the outputs' power.
const FIRST_R: i32 = -40;

/// One run of the merge, before its noise is known.
struct Candidate<'a> {
    name: &'a str,
    prepared: &'a Prepared,
    bank: &'a Bank,
    training: Vec<Samples<'a>>,
}

/// What the search found.
pub(super) struct Common {
    /// The noise of each run, in its data's units.
    pub(super) noise: Vec<NoiseConfig>,
    /// All settings tried; variances of scaled channels.
    pub(super) trials: Vec<Trial>,
}

/// Searches the setting that all runs are to have. `None` where the experiment gives the noise itself.
///
/// # Errors
/// [`IdentifyError::Interrupted`] with what is known in `memory`; data that cannot be used; runs of which one is advanced and another not.
pub(super) fn common_noise(
    parts: &[(String, Experiment)],
    memory: &mut Memory,
    progress: &dyn run::Progress,
) -> Result<Option<Common>, RunError> {
    let bank_of =
        |(name, part): &(String, Experiment)| run::bank(part, Path::new("")).map_err(|error| of_run(name, error));
    let banks: Vec<(Prepared, Option<Bank>)> = parts.par_iter().map(bank_of).collect::<Result<_, _>>()?;
    let mut candidates = Vec::new();
    for ((name, _), (prepared, bank)) in parts.iter().zip(&banks) {
        let Some(bank) = bank else { return Ok(None) };
        let first = &banks[0].0;
        if prepared.advanced != first.advanced {
            let samples = |count: usize| format!("advanced by {count} (set `preparation.advance`)");
            return Err(MergeError::Differ {
                run: name.clone(),
                what: "input is",
                found: samples(prepared.advanced),
                first: parts[0].0.clone(),
                expected: samples(first.advanced),
            }
            .into());
        }
        candidates.push(Candidate { name, prepared, bank, training: training(prepared) });
    }
    let score = |point: Point| score(&candidates, point, &|| !progress.interrupted());
    let bank = candidates[0].bank;
    let mut start = bank.start();
    if bank.sensor.is_none() {
        // A merge wants P to shrink slowly, so that each run has found its states by then: the smallest R are left to the descent.
        start.retain(|point| point.0 >= FIRST_R);
    }
    let tuned = tune_by(bank, start, &|done, total| progress.advance(done, total), memory, &score)
        .map_err(RunError::Identify)?;
    let noise = candidates
        .iter()
        .zip(parts)
        .map(|(candidate, (_, part))| in_data_units(&candidate.bank.noise(tuned.point), candidate, &part.noise));
    Ok(Some(Common { noise: noise.collect(), trials: tuned.trials }))
}

/// The merged model's free-run error over what each run held back, as the root of the mean square over the runs.
fn score(candidates: &[Candidate<'_>], point: Point, may_go_on: &(dyn Fn() -> bool + Sync)) -> Option<f64> {
    let learnt: Vec<Result<(Model, Estimate), Failed>> =
        candidates.par_iter().map(|candidate| candidate.learn(point, may_go_on)).collect();
    let interrupted = learnt.iter().any(|run| matches!(run, Err(Failed::Interrupted)));
    if interrupted {
        return None;
    }
    let Ok(learnt) = learnt.into_iter().collect::<Result<Vec<_>, _>>() else { return Some(f64::INFINITY) };
    let pieces: Vec<Piece<'_>> = candidates
        .iter()
        .zip(&learnt)
        .map(|(candidate, (model, estimate))| Piece { name: candidate.name, model, estimate })
        .collect();
    // A setting whose P is no covariance any more is not to be chosen, as one whose filter diverges.
    let Ok(merged) = join(&pieces) else { return Some(f64::INFINITY) };
    let errors: Vec<f64> = candidates.iter().map(|candidate| candidate.error(&merged)).collect();
    Some((errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt())
}

/// Why a filter gave nothing.
enum Failed {
    Diverged,
    Interrupted,
}

impl Candidate<'_> {
    /// The filter's model in the data's units, and what a merge needs beside it.
    fn learn(&self, point: Point, may_go_on: &(dyn Fn() -> bool + Sync)) -> Result<(Model, Estimate), Failed> {
        let plan = self.bank.plan(self.bank.noise(point));
        let ending = run(&plan, &self.training, None, &mut |_, _| may_go_on());
        let done = match ending {
            Ok(Ending::Done(done)) => done,
            Ok(Ending::Paused(_)) => return Err(Failed::Interrupted),
            Err(_) => return Err(Failed::Diverged),
        };
        let diverged = |_: RunError| Failed::Diverged;
        let scaled = scaled_model(&done.identified, &plan.form, self.prepared).map_err(diverged)?;
        let estimate =
            Estimate::new(&plan, &scaled, &done.identified, &done.innovations, self.prepared, BTreeMap::new())
                .map_err(diverged)?;
        let model = undo_scaling(&scaled, &scaling(self.prepared)).map_err(|_| Failed::Diverged)?;
        Ok((model, estimate))
    }

    /// The free-run error of the merged model on what this run held back; infinite where it diverges.
    fn error(&self, merged: &Model) -> f64 {
        let Ok(model) = as_run(merged, self.prepared) else { return f64::INFINITY };
        // Enough to tell the state from noise; all samples would take longer than the filter.
        let window = 10 * model.n();
        let of_record = |samples: &Samples<'_>| {
            let start = estimate_initial_state(&model, samples.inputs, samples.outputs, Some(window)).ok()?;
            let simulated = simulate(&model, samples.inputs, &start.state).ok()?.outputs;
            Some(
                error_measures(samples.outputs, simulated.view()).ok()?.overall_relative.powi(2) * samples.len() as f64,
            )
        };
        let sum: Option<f64> = self.training.iter().map(of_record).sum();
        let samples: usize = self.training.iter().map(Samples::len).sum();
        sum.map_or(f64::INFINITY, |sum| (sum / samples as f64).sqrt())
    }
}

/// The part of the merged model that a run has data of, for channels scaled as the run's.
fn as_run(merged: &Model, prepared: &Prepared) -> Result<Model, ModelError> {
    let own = &prepared.records[0].input_names;
    let places: Vec<usize> =
        own.iter().filter_map(|input| merged.inputs.iter().position(|name| name == input)).collect();
    let of_own = Model {
        inputs: own.clone(),
        b: merged.b.select_columns(&places),
        d: merged.d.select_columns(&places),
        parameter_covariance: None,
        ..merged.clone()
    };
    let scales = scaling(prepared);
    let over = |scales: &[f64]| scales.iter().map(|s| 1.0 / s).collect();
    let back =
        ChannelScaling { input_scale: over(&scales.input_scale), output_scale: over(&scales.output_scale), ..scales };
    undo_scaling(&of_own, &back)
}

/// The gain of a predictor with the merged model (canonical), fitted to the training part of the longest of `parts`, and how it was found; `None` if no gain
/// keeps the prediction bounded.
pub(super) fn predictor(
    merged: &Model,
    parts: &[(String, Experiment)],
) -> Result<Option<(DMatrix<f64>, String)>, RunError> {
    let data: Vec<Prepared> =
        parts.par_iter().map(|(_, part)| Ok(run::bank(part, Path::new(""))?.0)).collect::<Result<_, RunError>>()?;
    let longest = data.iter().max_by_key(|prepared| prepared.training.iter().copied().max());
    let Some((prepared, samples)) = longest.and_then(|prepared| Some((prepared, training(prepared).pop()?))) else {
        return Ok(None);
    };
    let own = as_run(merged, prepared)?;
    let Some(found) = fit_predictor(&own, samples) else { return Ok(None) };
    let in_units = undo_scaling(&Model { predictor_gain: Some(found.gain), ..own }, &scaling(prepared))?;
    Ok(in_units.predictor_gain.map(|gain| (gain, found.origin)))
}

/// The noise of scaled channels as a config gives it.
fn in_data_units(noise: &NoiseModel, candidate: &Candidate<'_>, asked: &NoiseConfig) -> NoiseConfig {
    let prepared = candidate.prepared;
    let per_state = candidate.bank.form.indices().iter().zip(&prepared.output_scales);
    let states: Vec<f64> = per_state.flat_map(|(&count, &scale)| vec![scale; count]).collect();
    let variances = |covariance: &Dense<f64>, scales: &[f64]| {
        Covariance::Diagonal(scales.iter().enumerate().map(|(i, s)| covariance.at(i, i) * s * s).collect())
    };
    NoiseConfig {
        from: NoiseSource::Given,
        read_as: NoiseReading::Covariance,
        sensor: Some(variances(&noise.sensor, &prepared.output_scales)),
        state: Some(variances(&noise.state, &states)),
        actuator: asked.actuator.is_some().then(|| variances(&noise.actuator, &prepared.input_scales)),
        zero_input_file: None,
        ..asked.clone()
    }
}
