//! A complete merge, either of the runs of an experiment or of finished runs.

use std::path::{Path, PathBuf};
use std::sync::Mutex;

use rayon::prelude::*;

use super::MergeError;
use super::finished::FinishedRun;
use super::held_out::{HeldOut, judge};
use super::merged::{Merged, merge};
use super::runs;
use super::split::split;
use super::tune::{common_noise, predictor};
use crate::experiment::{Experiment, to_toml};
use crate::identify::{IdentifyError, Trial};
use crate::run::{
    self, PeakRow, Progress, RunError, Saved, Truth, identity, is_finished, read_checkpoint, write_checkpoint,
};
use plid_data::prepare::Preparation;
use plid_data::{self as data, MissingPolicy};
use plid_file::write_atomic;

/// The results of a merge.
#[derive(Debug)]
pub struct Outcome {
    /// The name of the merge.
    pub name: String,
    /// The experiment, unless finished runs were merged.
    pub experiment: Option<Experiment>,
    /// SHA-256 of that experiment and of the files that it names.
    pub identity: Option<String>,
    /// The runs in the order of the model's inputs.
    pub runs: Vec<FinishedRun>,
    /// The merged model and the test of its consistency.
    pub merged: Merged,
    /// Simulations of held-out data in which all inputs act, one per record.
    pub held_out: Vec<HeldOut>,
    /// Peaks of the true plant and of the model, for simulated data.
    pub peaks: Vec<PeakRow>,
    /// The true plant, for simulated data.
    pub truth: Option<Truth>,
    /// The method that gave the predictor gain; `None` without a gain.
    pub predictor: Option<String>,
    /// The noise settings that were tried for all runs together; their variances are those of scaled channels.
    pub bank: Vec<Trial>,
    /// Warnings for the reader.
    pub warnings: Vec<String>,
}

/// Carries out an experiment whose structure is `simo-merge`: one run per input, in parallel, each with its report in
/// `directory`/runs, followed by the merge. With `resume`, finished runs are kept and interrupted runs continue.
///
/// # Errors
/// Returns the [`RunError`] of the first run that fails, or that of the merge.
pub fn carry_out(
    experiment: &Experiment,
    base: &Path,
    directory: &Path,
    resume: bool,
    progress: &dyn Progress,
) -> Result<Outcome, RunError> {
    if let Some((key, reason)) = experiment.problems().into_iter().next() {
        return Err(RunError::Setting { key, reason });
    }
    let identity = identity(experiment, base)?;
    let mut parts = split(experiment, base)?;
    progress.stage("noise covariances");
    let mut saved = if resume { read_checkpoint(directory, &identity)? } else { Saved::default() };
    let trials = match common_noise(&parts, &mut saved.memory, progress) {
        Err(RunError::Identify(IdentifyError::Interrupted)) => {
            return Err(write_checkpoint(Some(directory), &identity, saved.memory, None));
        }
        Err(other) => return Err(other),
        Ok(None) => Vec::new(),
        Ok(Some(common)) => {
            parts.iter_mut().zip(common.noise).for_each(|((_, part), noise)| part.noise = noise);
            common.trials
        }
    };
    let Some(directories) = all_runs(&parts, directory, &identity, resume, progress)? else {
        return Err(write_checkpoint(Some(directory), &identity, saved.memory, None));
    };
    progress.stage("merge");
    let read = |((name, _), directory): (&(String, Experiment), &PathBuf)| {
        Ok(FinishedRun { name: format!("runs/{name}"), ..FinishedRun::read(directory)? })
    };
    let runs = parts.iter().zip(&directories).map(read).collect::<Result<Vec<_>, RunError>>()?;
    let mut outcome = of_runs(&experiment.name, runs)?;
    progress.stage("validation");
    if let Some((gain, origin)) = predictor(&outcome.merged.canonical, &parts)? {
        outcome.merged.canonical.predictor_gain = Some(gain.clone());
        outcome.merged.model.predictor_gain = Some(gain);
        outcome.predictor = Some(origin);
    }
    outcome.validate(experiment, base)?;
    outcome.bank = trials;
    outcome.experiment = Some(experiment.clone());
    outcome.identity = Some(identity);
    Ok(outcome)
}

/// Carries out the runs in parallel and returns their directories; `None` if they were interrupted.
fn all_runs(
    parts: &[(String, Experiment)],
    directory: &Path,
    identity: &str,
    resume: bool,
    progress: &dyn Progress,
) -> Result<Option<Vec<PathBuf>>, RunError> {
    let together = Together::new(progress, parts.len());
    let is_own = resume && is_finished(directory, identity);
    let runs = runs::folder(directory, is_own, resume).map_err(run::file_error(directory))?;
    let directories: Vec<PathBuf> = parts.iter().map(|(name, _)| runs::of_input(&runs, name)).collect();
    progress.stage(&format!("{} runs", parts.len()));
    let done: Vec<Result<(), RunError>> = parts
        .par_iter()
        .zip(&directories)
        .enumerate()
        .map(|(number, ((name, part), directory))| {
            one_run(part, directory, resume, &together.of(number)).map_err(|error| of_run(name, error))
        })
        .collect();
    if done.iter().any(|run| matches!(run, Err(RunError::Interrupted { .. }))) {
        return Ok(None);
    }
    done.into_iter().collect::<Result<(), _>>()?;
    Ok(Some(directories))
}

/// Merges finished runs in the given order.
///
/// # Errors
/// Returns a [`RunError`] if the runs cannot be merged.
pub fn of_runs(name: &str, runs: Vec<FinishedRun>) -> Result<Outcome, RunError> {
    let merged = merge(&runs)?;
    let mut warnings = merged.remarks.clone();
    if let Some(unstable) = plid_model::stability(&merged.model)?.warning() {
        warnings.push(unstable.to_string());
    }
    let (held_out, peaks) = (Vec::new(), Vec::new());
    Ok(Outcome {
        name: name.into(),
        experiment: None,
        identity: None,
        runs,
        merged,
        held_out,
        peaks,
        truth: None,
        predictor: None,
        bank: Vec::new(),
        warnings,
    })
}

impl Outcome {
    /// Simulates the merged model on a record in which all inputs act, and scores the part after its leading fraction
    /// `share`.
    ///
    /// # Errors
    /// Returns an error for a file that cannot be read, lacks a channel, or has a different sample rate.
    pub fn judge_file(&mut self, file: &Path, share: f64) -> Result<(), RunError> {
        let merged = &self.merged;
        let experiment = &self.runs[0].experiment;
        let table = data::read(file, experiment.data.variable.as_deref())?;
        let rate = experiment.data.sample_rate_hz;
        let (record, _) = data::select(&table, &merged.model.inputs, &merged.model.outputs, rate, MissingPolicy::Nan)?;
        // The record is not a series of repeats.
        let preparation = Preparation { repeats: None, ..experiment.preparation.clone() };
        let name = file.display().to_string();
        let judged = judge(&merged.canonical, merged.advanced, &name, vec![record], share, &preparation, None)?;
        self.held_out.push(judged);
        Ok(())
    }

    /// Simulates the merged model on data in which all inputs act: the simulated truss, or the file for validation.
    fn validate(&mut self, experiment: &Experiment, base: &Path) -> Result<(), RunError> {
        let share = experiment.validation.training_share;
        if experiment.data.testbed.is_some() {
            let mut all = experiment.clone();
            let obtained = run::obtain(&mut all, base)?;
            let truth = obtained.truth;
            let noise_free = truth.as_ref().map(|truth| &truth.noise_free);
            let Merged { canonical, advanced, .. } = &self.merged;
            let name = "the truss with all inputs driven";
            let judged = judge(canonical, *advanced, name, obtained.records, share, &all.preparation, noise_free)?;
            self.held_out.push(judged);
            self.with_truth(truth)?;
        } else if let Some(file) = &experiment.validation.file {
            self.judge_file(&base.join(file), share)?;
        }
        Ok(())
    }

    fn with_truth(&mut self, truth: Option<Truth>) -> Result<(), RunError> {
        if let Some(truth) = &truth {
            self.peaks = run::compare_peaks(truth, &self.merged.model)?;
        }
        self.truth = truth;
        Ok(())
    }
}

/// Adds the run's name to an error; an interruption applies to the whole merge.
pub(super) fn of_run(name: &str, error: RunError) -> RunError {
    match error {
        RunError::Interrupted { .. } | RunError::Identify(IdentifyError::Interrupted) => error,
        other => MergeError::Run { run: name.into(), source: Box::new(other) }.into(),
    }
}

fn one_run(experiment: &Experiment, directory: &Path, resume: bool, progress: &dyn Progress) -> Result<(), RunError> {
    let config = directory.join("experiment.toml");
    let text = to_toml(experiment);
    // The config is written last, so that its presence shows that the run is complete.
    let is_the_same = std::fs::read_to_string(&config).is_ok_and(|there| there == text);
    if resume && is_the_same && is_finished(directory, &identity(experiment, Path::new(""))?) {
        return Ok(());
    }
    // An incomplete run must not look complete.
    match std::fs::remove_file(&config) {
        Err(source) if source.kind() != std::io::ErrorKind::NotFound => {
            return Err(RunError::File { path: config, source });
        }
        _ => {}
    }
    let outcome = run::carry_out(experiment, Path::new(""), Some(directory), resume, progress)?;
    run::write(&outcome, directory)?;
    write_atomic(&config, text.as_bytes()).map_err(|source| RunError::File { path: config, source })
}

/// The combined progress of several parallel runs, whose steps are summed.
struct Together<'a> {
    whole: &'a dyn Progress,
    steps: Mutex<Vec<(usize, usize)>>,
}

struct Part<'a> {
    together: &'a Together<'a>,
    number: usize,
}

impl<'a> Together<'a> {
    fn new(whole: &'a dyn Progress, runs: usize) -> Self {
        Self { whole, steps: Mutex::new(vec![(0, 0); runs]) }
    }

    fn of(&'a self, number: usize) -> Part<'a> {
        Part { together: self, number }
    }
}

impl Progress for Part<'_> {
    fn stage(&self, _name: &str) {}

    fn advance(&self, done: usize, total: usize) {
        let mut steps = self.together.steps.lock().unwrap_or_else(|e| e.into_inner());
        steps[self.number] = (done, total);
        let sum = steps.iter().fold((0, 0), |sum, step| (sum.0 + step.0, sum.1 + step.1));
        self.together.whole.advance(sum.0, sum.1);
    }

    fn interrupted(&self) -> bool {
        self.together.whole.interrupted()
    }
}
