//! Selection among several starting models. Each is refined on the first part of the training data and scored by its
//! simulation of the rest; the best is then refined on all training data. A start is not refined if its error is far
//! above that of the best one refined so far.

use nalgebra::DVector;
use ndarray::s;
use plid_model::{Model, ModelError, simulate};

use crate::error::RefineError;
use crate::record::Record;
use crate::refine::{Noise, Options, Refined, Watcher, refine};

/// A starting model and its name.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// The name used in reports.
    pub name: String,
    /// The model to start from.
    pub model: Model,
}

/// The scores of the starting models, and the model refined from the best of them.
#[derive(Clone, Debug)]
pub struct Choice {
    /// The scores of each starting model, refined on the first part of the training data for white noise and then for
    /// coloured noise. The error is infinite if the refinement failed. A start that was not refined has one score.
    pub scores: Vec<Score>,
    /// Index of the selected entry of `scores`.
    pub chosen: usize,
    /// The selected model, refined on all training data.
    pub refined: Refined,
}

/// The score of one starting model and one noise assumption.
#[derive(Clone, Debug, PartialEq)]
pub struct Score {
    /// The name of the starting model.
    pub start: String,
    /// The noise assumed in the refinement; `None` if the start was not refined because it was far worse than an
    /// earlier refined one.
    pub noise: Option<Noise>,
    /// RMS of the simulation error over RMS of the output on the last part of the training data.
    pub error: f64,
}

/// The fraction of the last training record that selects the starting model.
const DECIDING: f64 = 0.25;

/// A start whose error exceeds the smallest refined one by this factor is not refined.
const FAR: f64 = 2.0;

/// Returns the records without the last quarter of the last record, which is reserved for the selection and must not be
/// used to obtain a starting model.
///
/// # Errors
/// Returns [`RefineError::NoRecords`] for an empty list.
pub fn head<'a>(records: &[Record<'a>]) -> Result<Vec<Record<'a>>, RefineError> {
    let (last, before) = records.split_last().ok_or(RefineError::NoRecords)?;
    Ok(before.iter().copied().chain([last.range(0, cut(last))]).collect())
}

/// Returns the first sample of the part that is reserved for the selection.
fn cut(last: &Record<'_>) -> usize {
    ((1.0 - DECIDING) * last.samples() as f64).round() as usize
}

/// Selects among starting models and refines the best. Each is refined on the [`head`] of the records with a third of
/// the iterations, first for white noise and then for coloured noise. The one that best simulates the rest of the last
/// record is refined on all records. `options.noise` is ignored.
///
/// # Errors
/// Returns a [`RefineError`] if no starting model could be refined.
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
    let mut best: Option<(usize, Noise, Model)> = None;
    let mut reason = None;
    let judged = |refined: &Refined| {
        let state = &refined.initial_states[refined.initial_states.len() - 1];
        free_run_error(&refined.model, last, state, cut(last))
    };
    for (number, start) in starts.iter().enumerate() {
        if let Some((place, ..)) = best {
            // B, D and the initial states are fitted to the start, but nothing else.
            let only_fitted = Options { iterations: 0, ..first_try.clone() };
            let told = |_: usize, _: usize| watcher(2 * number * first_try.iterations, planned);
            if let Ok(unrefined) = refine(&start.model, &head, &only_fitted, &told) {
                let error = judged(&unrefined)?;
                if error > FAR * scores[place].error {
                    scores.push(Score { start: start.name.clone(), noise: None, error });
                    continue;
                }
            }
        }
        let mut from = start.model.clone();
        for (kind, noise) in [Noise::White, Noise::Coloured].into_iter().enumerate() {
            let before = (2 * number + kind) * first_try.iterations;
            let told = |done: usize, _: usize| watcher(before + done, planned);
            let error = match refine(&from, &head, &Options { noise, ..first_try.clone() }, &told) {
                Err(RefineError::Interrupted) => return Err(RefineError::Interrupted),
                Err(other) => {
                    reason.get_or_insert(other);
                    f64::INFINITY
                }
                Ok(refined) => {
                    let error = judged(&refined)?;
                    if best.as_ref().is_none_or(|(place, ..)| error < scores[*place].error) {
                        best = Some((scores.len(), noise, refined.model.clone()));
                    }
                    from = refined.model;
                    error
                }
            };
            scores.push(Score { start: start.name.clone(), noise: Some(noise), error });
        }
    }
    let Some((chosen, noise, model)) = best else { return Err(reason.unwrap_or(RefineError::NoRecords)) };
    let before = 2 * starts.len() * first_try.iterations;
    let told = |done: usize, _: usize| watcher(before + done, planned);
    let refined = refine(&model, records, &Options { noise, ..options.clone() }, &told)?;
    Ok(Choice { scores, chosen, refined })
}

/// Returns the relative simulation error of `model` on `record` from sample `from` on, with `state` at the first sample
/// of the record: the RMS of the error over the RMS of the output, over all outputs scaled to unit RMS. It is infinite
/// if the simulation diverges.
///
/// # Errors
/// Returns a [`ModelError`] if the record does not fit the model.
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
