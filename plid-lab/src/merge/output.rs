//! The output files of a merge: model.json, report.html and result.json. Each is written atomically, and the same merge
//! gives the same bytes.

use std::path::Path;

use serde_json::{Value, json};

use super::carry_out::Outcome;
use super::finished::FinishedRun;
use super::held_out::HeldOut;
use super::report;
use super::runs::{RUNS, replace_runs};
use crate::run::{
    CHECKPOINT, RESULT, RunError, errors_json, file_error, modes_json, peaks_json, strict_json, typed, with,
};
use plid_file::{Staged, write_atomic};

/// Writes all files of a merge into `directory`. Together they replace those of an earlier merge. If anything fails,
/// the earlier merge remains unchanged.
///
/// # Errors
/// Returns an error if a file cannot be written or a frequency response cannot be computed.
pub fn write(outcome: &Outcome, directory: &Path) -> Result<(), RunError> {
    let staged = Staged::new(directory).map_err(file_error(directory))?;
    let put = |name: &str, text: &str| {
        write_atomic(&staged.path().join(name), text.as_bytes()).map_err(file_error(&directory.join(name)))
    };
    let page = report::page(outcome)?;
    outcome.merged.model.write(&staged.path().join("model.json"))?;
    put("report.html", &page)?;
    let path = directory.join(RESULT);
    put(RESULT, &strict_json(&path, &result(outcome, &path)?)?)?;
    if outcome.experiment.is_some() {
        replace_runs(directory).map_err(file_error(&directory.join(RUNS)))?;
    }
    staged.commit(RESULT, &[CHECKPOINT]).map_err(file_error(directory))
}

fn result(outcome: &Outcome, path: &Path) -> Result<Value, RunError> {
    let merged = &outcome.merged;
    let model = &merged.model;
    let run = |run: &FinishedRun| {
        let value = json!({
            "run": run.name, "experiment": run.experiment.name, "inputs": run.model.inputs,
            "training_samples": run.training_samples, "innovation_ratio": run.estimate.innovation_ratio,
        });
        with(value, [("free_run_relative", run.free_run.map(|error| json!(error)))])
    };
    let held_out = |held_out: &HeldOut| {
        let optional = |measures: &Option<_>| measures.as_ref().map(|measures| errors_json(measures, &model.outputs));
        let value = json!({
            "record": held_out.record, "samples": held_out.measured.nrows(),
            "free_run": errors_json(&held_out.errors, &model.outputs),
        });
        let one_step = ("one_step", optional(&held_out.one_step_errors));
        with(value, [one_step, ("free_run_of_the_true_plant", optional(&held_out.truth_errors))])
    };
    let runs: Vec<Value> = outcome.runs.iter().map(run).collect();
    let held_out: Vec<Value> = outcome.held_out.iter().map(held_out).collect();
    let value = json!({
        "name": outcome.name,
        "sample_rate_hz": model.sample_rate_hz,
        "inputs": model.inputs,
        "outputs": model.outputs,
        "states": model.n(),
        "training_samples": outcome.runs.iter().map(|run| run.training_samples).sum::<usize>(),
        "input_advanced_by": merged.advanced,
        "runs": runs,
        "consistency": typed(path, "consistency", &merged.consistency)?,
        "verdict": report::verdict(outcome),
        "held_out": held_out,
        "noise_bank": typed(path, "noise_bank", &outcome.bank)?,
        "modes": modes_json(&merged.canonical)?,
        "peaks": peaks_json(&outcome.peaks),
        "warnings": outcome.warnings,
    });
    let optional = [
        ("identity_sha256", outcome.identity.as_ref().map(|identity| json!(identity))),
        ("predictor", outcome.predictor.as_ref().map(|predictor| json!(predictor))),
        ("observability_indices", model.observability_indices.as_ref().map(|indices| json!(indices))),
    ];
    Ok(with(value, optional))
}
