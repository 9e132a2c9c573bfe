//! The output files of a merge: model.json, report.html and result.json. Each is written atomically, and the same merge
//! gives the same bytes.

use std::path::Path;

use serde_json::{Value, json};

use super::carry_out::Outcome;
use super::report;
use crate::run::{CHECKPOINT, RunError, errors_json, modes_json, peaks_json, pretty};
use plid_report::write_atomic;

/// Writes all files of a merge into `directory`.
///
/// # Errors
/// Returns an error if a file cannot be written or a frequency response cannot be computed.
pub fn write(outcome: &Outcome, directory: &Path) -> Result<(), RunError> {
    let put = |name: &str, text: &str| {
        let path = directory.join(name);
        write_atomic(&path, text.as_bytes()).map_err(|source| RunError::File { path, source })
    };
    std::fs::create_dir_all(directory).map_err(|source| RunError::File { path: directory.into(), source })?;
    let page = report::page(outcome)?;
    outcome.merged.model.write(&directory.join("model.json"))?;
    put("report.html", &page)?;
    // It is written last, so that its presence shows that the other files are complete.
    put("result.json", &pretty(&result(outcome)?))?;
    let checkpoint = directory.join(CHECKPOINT);
    match std::fs::remove_file(&checkpoint) {
        Err(source) if source.kind() != std::io::ErrorKind::NotFound => {
            Err(RunError::File { path: checkpoint, source })
        }
        _ => Ok(()),
    }
}

fn result(outcome: &Outcome) -> Result<Value, RunError> {
    let merged = &outcome.merged;
    let model = &merged.model;
    let runs: Vec<Value> = outcome
        .runs
        .iter()
        .map(|run| {
            json!({ "run": run.name, "experiment": run.experiment.name, "inputs": run.model.inputs, "training_samples": run.training_samples,
                    "innovation_ratio": run.estimate.innovation_ratio, "free_run_relative": run.free_run })
        })
        .collect();
    let held_out: Vec<Value> = outcome
        .held_out
        .iter()
        .map(|held_out| {
            json!({ "record": held_out.record, "samples": held_out.measured.nrows(), "free_run": errors_json(&held_out.errors),
                    "one_step": held_out.one_step_errors.as_ref().map(errors_json),
                    "free_run_of_the_true_plant": held_out.truth_errors.as_ref().map(errors_json) })
        })
        .collect();
    Ok(json!({
        "name": outcome.name,
        "identity_sha256": outcome.identity,
        "sample_rate_hz": model.sample_rate_hz,
        "inputs": model.inputs,
        "outputs": model.outputs,
        "states": model.n(),
        "observability_indices": model.observability_indices,
        "training_samples": outcome.runs.iter().map(|run| run.training_samples).sum::<usize>(),
        "input_advanced_by": merged.advanced,
        "runs": runs,
        "consistency": merged.consistency,
        "verdict": report::verdict(outcome),
        "held_out": held_out,
        "predictor": outcome.predictor,
        "noise_bank": outcome.bank,
        "modes": modes_json(&merged.canonical)?,
        "peaks": peaks_json(&outcome.peaks),
        "warnings": outcome.warnings,
    }))
}
