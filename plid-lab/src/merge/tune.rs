//! Selection of one setting of the noise covariances for all runs by the simulation error of the merged model.
//!
//! Tuning each run separately would give covariances decades apart, because the simulation error of a single run hardly
//! depends on them. That of the merged model does: the weight of each run in the merge is given by the shape of its P,
//! which R and Sigma determine.

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
use crate::identify::{Bank, Ending, Memory, Point, Samples, Trial, run, tune_by};
use crate::run::{self, Estimate, RunError, scaled_model, scaling, training};
use plid_data::prepare::Prepared;
use plid_refine::fit_predictor;

/// The smallest R at which the search starts, in tenths of a decade: 1e-4 of the outputs' power.
const FIRST_R: i32 = -40;

/// A run of the merge whose noise is not yet known.
struct Candidate<'a> {
    name: &'a str,
    prepared: &'a Prepared,
    bank: &'a Bank,
    training: Vec<Samples<'a>>,
}

/// The result of the search.
pub(super) struct Common {
    /// The noise of each run, in its data's units.
    pub(super) noise: Vec<NoiseConfig>,
    /// All settings tried, as variances of scaled channels.
    pub(super) trials: Vec<Trial>,
}

/// Searches for the common noise setting of all runs. Returns `None` if the experiment specifies the noise.
///
/// # Errors
/// Returns [`IdentifyError::Interrupted`] with the scores so far in `memory`, and an error for data that cannot be used
/// or runs that differ in the advance of their input.
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
        // A merge requires P to shrink slowly enough for each run to find its states first, so the smallest R are
        // reached only by the descent.
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

/// Returns the simulation error of the merged model on the reserved part of each run, as the root mean square over the
/// runs.
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
    // A setting whose P is no longer positive definite counts as a setting whose filter diverges.
    let Ok(merged) = join(&pieces) else { return Some(f64::INFINITY) };
    let errors: Vec<f64> = candidates.iter().map(|candidate| candidate.error(&merged)).collect();
    Some((errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt())
}

/// The reason why a filter did not give a model.
enum Failed {
    Diverged,
    Interrupted,
}

impl Candidate<'_> {
    /// Runs the filter and returns its model in the data's units with the additional quantities that a merge needs.
    fn learn(&self, point: Point, may_go_on: &(dyn Fn() -> bool + Sync)) -> Result<(Model, Estimate), Failed> {
        let plan = self.bank.plan(self.bank.noise(point));
        let ending = run(&plan, &self.training, None, &mut |_, _| may_go_on());
        let done = match ending {
            Ok(Ending::Done(done)) => done,
            Ok(Ending::Paused(_)) => return Err(Failed::Interrupted),
            Err(_) => return Err(Failed::Diverged),
        };
        let diverged = |_: RunError| Failed::Diverged;
        let scaled = scaled_model(&done.identified, self.prepared).map_err(diverged)?;
        let estimate =
            Estimate::new(&plan, &scaled, &done.identified, &done.innovations, self.prepared, BTreeMap::new())
                .map_err(diverged)?;
        let model = undo_scaling(&scaled, &scaling(self.prepared)).map_err(|_| Failed::Diverged)?;
        Ok((model, estimate))
    }

    /// Returns the simulation error of the merged model on the reserved part of this run; infinite if it diverges.
    fn error(&self, merged: &Model) -> f64 {
        let Ok(model) = as_run(merged, self.prepared) else { return f64::INFINITY };
        // A limited number of samples is enough to separate the state from the noise; using all of them would take
        // longer than the filter.
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

/// Returns the part of the merged model for the inputs of a run, for channels scaled as in the run.
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

/// Fits the predictor gain of the merged model (canonical) to the training part of the longest of `parts`, and
/// describes the method. Returns `None` if no gain keeps the prediction bounded.
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
    let Some(found) = fit_predictor(&own, samples.inputs, samples.outputs) else { return Ok(None) };
    let in_units = undo_scaling(&Model { predictor_gain: Some(found.gain), ..own }, &scaling(prepared))?;
    Ok(in_units.predictor_gain.map(|gain| (gain, found.origin)))
}

/// Returns the noise of scaled channels in the form of a config.
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
