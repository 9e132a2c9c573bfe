//! Several starts. Each is refined on the head of the training data and scored by its free run on the tail; the best is refined on all of it.

use nalgebra::DVector;
use ndarray::s;
use plid_model::{Model, ModelError, estimate_initial_state, simulate};

use crate::error::RefineError;
use crate::record::{Record, Start};
use crate::refine::{Options, Refined, Watcher, refine};

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
    /// Name and free-run error of each start, refined on the head, on the tail of the training data; infinite where it failed.
    pub scores: Vec<(String, f64)>,
    /// The start that was taken.
    pub chosen: usize,
    /// It, refined on all training data.
    pub refined: Refined,
}

/// The share of the last training record that decides between starts.
const DECIDING: f64 = 0.25;

/// Refines each start on all but the last quarter of the last training record, takes the one that simulates that quarter best, and refines it on all the data.
///
/// `make` gives the starts for the records that they may learn from: it is called with the head, so that nothing of the deciding slice reaches a start through it, and not again. The last refinement goes on from the model that
/// was best.
///
/// # Errors
/// [`RefineError`] if no start could be refined.
pub fn best_of(
    starts: &[Candidate],
    records: &[Record<'_>],
    options: &Options,
    watcher: Watcher<'_>,
) -> Result<Choice, RefineError> {
    let (last, before) = records.split_last().ok_or(RefineError::NoRecords)?;
    let cut = ((1.0 - DECIDING) * last.samples() as f64).round() as usize;
    let head: Vec<Record<'_>> = before.iter().copied().chain([last.range(0, cut)]).collect();
    let stages = starts.len() + 1;
    let mut scores = Vec::new();
    let mut best: Option<(usize, f64, Model)> = None;
    let mut reason = None;
    for (number, start) in starts.iter().enumerate() {
        let told = |done: usize, total: usize| watcher(number * total + done, stages * total);
        let score = match refine(&start.model, &head, options, &told) {
            Err(RefineError::Interrupted) => return Err(RefineError::Interrupted),
            Err(other) => {
                reason.get_or_insert(other);
                f64::INFINITY
            }
            Ok(refined) => {
                let state = &refined.initial_states[refined.initial_states.len() - 1];
                let error = free_run_error(&refined.model, last, state, cut)?;
                if best.as_ref().is_none_or(|b| error < b.1) {
                    best = Some((number, error, refined.model));
                }
                error
            }
        };
        scores.push((start.name.clone(), score));
    }
    let Some((chosen, _, model)) = best else { return Err(reason.unwrap_or(RefineError::NoRecords)) };
    let told = |done: usize, total: usize| watcher(starts.len() * total + done, stages * total);
    let refined = refine(&model, records, options, &told)?;
    Ok(Choice { scores, chosen, refined })
}

/// Free-run error of `model` on `record` from sample `from` on, started with `state` at the record's first sample: RMS of the error over RMS of the output, over all outputs scaled
/// to unit RMS; infinite where it diverges.
///
/// # Errors
/// [`ModelError`] for records of another shape.
pub fn free_run_error(model: &Model, record: &Record<'_>, state: &DVector<f64>, from: usize) -> Result<f64, ModelError> {
    let run = match simulate(model, record.inputs, state) {
        Ok(run) => run.outputs,
        Err(ModelError::Diverged { .. }) => return Ok(f64::INFINITY),
        Err(other) => return Err(other),
    };
    let (measured, run) = (record.outputs.slice(s![from.., ..]), run.slice_move(s![from.., ..]));
    let measures = plid_model::signal::error_measures(measured, run.view());
    Ok(measures.map_or(f64::INFINITY, |m| m.overall_relative))
}

/// The state at the first sample with which `model` simulates `record` best; zero at rest.
pub fn fitted_state(model: &Model, record: &Record<'_>) -> Result<DVector<f64>, ModelError> {
    match record.start {
        Start::Rest => Ok(model.rest()),
        Start::Unknown => Ok(estimate_initial_state(model, record.inputs, record.outputs, None)?.state),
    }
}
