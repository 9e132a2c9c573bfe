//! Several starts. Each is refined on the head of the training data and scored by its free run on the tail; the best is refined on all of it.

use nalgebra::DVector;
use ndarray::s;
use plid_model::{Model, ModelError, simulate};

use crate::error::RefineError;
use crate::record::Record;
use crate::refine::{Noise, Options, Refined, Watcher, refine};

/// A start by its name.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// As reports call it.
    pub name: String,
    /// The model to start from.
    pub model: Model,
}

/// How the starts did, and the model refined from the best.
#[derive(Clone, Debug)]
pub struct Choice {
    /// Each start refined on the head, for white noise and then for coloured, and its free-run error on the tail of the training data; infinite where it
    /// failed.
    pub scores: Vec<Score>,
    /// The one that was taken.
    pub chosen: usize,
    /// It, refined on all training data.
    pub refined: Refined,
}

/// How a start did.
#[derive(Clone, Debug, PartialEq)]
pub struct Score {
    /// Its name.
    pub start: String,
    /// What the noise was taken for.
    pub noise: Noise,
    /// RMS of the free-run error over RMS of the output.
    pub error: f64,
}

/// The share of the last training record that decides between starts.
const DECIDING: f64 = 0.25;

/// What starts may learn from, so that nothing of the slice that decides between them reaches one: all but the last quarter of the last record.
///
/// # Errors
/// [`RefineError::NoRecords`]
pub fn head<'a>(records: &[Record<'a>]) -> Result<Vec<Record<'a>>, RefineError> {
    let (last, before) = records.split_last().ok_or(RefineError::NoRecords)?;
    Ok(before.iter().copied().chain([last.range(0, cut(last))]).collect())
}

/// The first deciding sample.
fn cut(last: &Record<'_>) -> usize {
    ((1.0 - DECIDING) * last.samples() as f64).round() as usize
}

/// Refines each start on the [`head`] of the records, in a third of the steps, with the noise taken for white and then for coloured; takes the one that simulates the rest of the last record best, and goes on with it on all records. `options.noise` is not looked at.
///
/// # Errors
/// [`RefineError`] if no start could be refined.
pub fn best_of(
    starts: &[Candidate],
    records: &[Record<'_>],
    options: &Options,
    watcher: Watcher<'_>,
) -> Result<Choice, RefineError> {
    let head = head(records)?;
    let last = &records[records.len() - 1];
    let first_try = Options { iterations: options.iterations.div_ceil(3), ..options.clone() };
    let planned = 2 * starts.len() * first_try.iterations + options.iterations;
    let mut scores: Vec<Score> = Vec::new();
    let mut best: Option<(usize, Model)> = None;
    let mut reason = None;
    for start in starts {
        let mut from = start.model.clone();
        for noise in [Noise::White, Noise::Coloured] {
            let before = scores.len() * first_try.iterations;
            let told = |done: usize, _: usize| watcher(before + done, planned);
            let error = match refine(&from, &head, &Options { noise, ..first_try.clone() }, &told) {
                Err(RefineError::Interrupted) => return Err(RefineError::Interrupted),
                Err(other) => {
                    reason.get_or_insert(other);
                    f64::INFINITY
                }
                Ok(refined) => {
                    let state = &refined.initial_states[refined.initial_states.len() - 1];
                    let error = free_run_error(&refined.model, last, state, cut(last))?;
                    if best.as_ref().is_none_or(|(place, _)| error < scores[*place].error) {
                        best = Some((scores.len(), refined.model.clone()));
                    }
                    from = refined.model;
                    error
                }
            };
            scores.push(Score { start: start.name.clone(), noise, error });
        }
    }
    let Some((chosen, model)) = best else { return Err(reason.unwrap_or(RefineError::NoRecords)) };
    let before = scores.len() * first_try.iterations;
    let told = |done: usize, _: usize| watcher(before + done, planned);
    let refined = refine(&model, records, &Options { noise: scores[chosen].noise, ..options.clone() }, &told)?;
    Ok(Choice { scores, chosen, refined })
}

/// Free-run error of `model` on `record` from sample `from` on, started with `state` at the record's first sample: RMS of the error over RMS of the output, over all outputs scaled
/// to unit RMS; infinite where it diverges.
///
/// # Errors
/// [`ModelError`] for records of another shape.
pub fn free_run_error(
    model: &Model,
    record: &Record<'_>,
    state: &DVector<f64>,
    from: usize,
) -> Result<f64, ModelError> {
    let run = match simulate(model, record.inputs, state) {
        Ok(run) => run.outputs,
        Err(ModelError::Diverged { .. }) => return Ok(f64::INFINITY),
        Err(other) => return Err(other),
    };
    let (measured, run) = (record.outputs.slice(s![from.., ..]), run.slice_move(s![from.., ..]));
    let measures = plid_model::signal::error_measures(measured, run.view());
    Ok(measures.map_or(f64::INFINITY, |m| m.overall_relative))
}
