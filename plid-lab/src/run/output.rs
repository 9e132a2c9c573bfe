//! The output files of a run: result.json, model.json, model-refined.json, model-subspace.json, innovations.csv,
//! manifest.json, report.html and its first figure, frf.svg. Each is written atomically. The same run gives the same
//! bytes, because no file contains a time or an absolute path.

use std::fmt::Write as _;
use std::path::Path;

use plid_refine::{Noise, Score};
use serde_json::{Map, Value, json};

use super::error::RunError;
use super::validate::Errors;
use super::{Alternative, CHECKPOINT, Outcome, PeakRow, report};
use crate::experiment::to_toml;
use plid_catalogue::Conditions;
use plid_model::{ModeDeviation, Model, mode_deviations};
use plid_report::write_atomic;

/// Writes all files of a run into `directory` and removes its checkpoint.
///
/// # Errors
/// Returns an error if a file cannot be written or a frequency response cannot be computed.
pub fn write(outcome: &Outcome, directory: &Path) -> Result<(), RunError> {
    let file = |name: &str| directory.join(name);
    let put = |name: &str, bytes: &[u8]| {
        write_atomic(&file(name), bytes).map_err(|source| RunError::File { path: file(name), source })
    };
    std::fs::create_dir_all(directory).map_err(|source| RunError::File { path: directory.into(), source })?;
    let (page, responses) = report::page(outcome)?;
    put("innovations.csv", innovations(outcome).as_bytes())?;
    with_provenance(outcome).write(&file("model.json"))?;
    simulation_models(outcome, directory)?;
    put("manifest.json", pretty(&manifest(outcome)).as_bytes())?;
    put("frf.svg", responses.as_bytes())?;
    put("report.html", page.as_bytes())?;
    // It is written last, so that its presence shows that the other files are complete.
    put("result.json", pretty(&result(outcome)?).as_bytes())?;
    match std::fs::remove_file(file(CHECKPOINT)) {
        Err(source) if source.kind() != std::io::ErrorKind::NotFound => {
            Err(RunError::File { path: file(CHECKPOINT), source })
        }
        _ => Ok(()),
    }
}

/// Writes model-refined.json and model-subspace.json, and removes files of an earlier run that this run does not
/// replace.
fn simulation_models(outcome: &Outcome, directory: &Path) -> Result<(), RunError> {
    let simulation = &outcome.simulation;
    let refined = simulation.refined.as_ref().filter(|_| !simulation.refined_is_worse).map(|(model, _)| model);
    for (name, alternative) in [("model-refined.json", refined), ("model-subspace.json", simulation.subspace.as_ref())]
    {
        let path = directory.join(name);
        match alternative {
            Some(alternative) => {
                let provenance = with_provenance(outcome).provenance.map(|mut provenance| {
                    provenance.remove("predictor");
                    provenance.insert("held_out_free_run".into(), json!(alternative.free_run_errors.overall_relative));
                    provenance
                });
                Model { provenance, ..alternative.model.clone() }.write(&path)?;
            }
            None => match std::fs::remove_file(&path) {
                Err(source) if source.kind() != std::io::ErrorKind::NotFound => {
                    return Err(RunError::File { path, source });
                }
                _ => {}
            },
        }
    }
    Ok(())
}

/// Returns the figures of the additional models for simulation, `refined` and `subspace`.
fn simulation(outcome: &Outcome) -> Result<Value, RunError> {
    let simulation = &outcome.simulation;
    let figures = |model: &Alternative| json!({ "one_step": model.one_step_errors.as_ref().map(errors), "free_run": errors(&model.free_run_errors) });
    let refined = simulation.refined.as_ref().map(|(model, path)| -> Result<Value, RunError> {
        let mut value = figures(model);
        let modes: Vec<Value> = path.mode_deviations(&model.model)?.iter().map(mode).collect();
        let starts: Vec<Value> = path.scores.iter().map(score).collect();
        value["handed_over"] = json!(!simulation.refined_is_worse);
        value["starts"] = json!(starts);
        value["start_taken"] = score(&path.scores[path.chosen]);
        value["iterations"] = json!(path.iterations);
        value["converged"] = json!(path.converged);
        value["poles_at_limit"] = json!(path.poles_at_limit);
        value["modes"] = json!(modes);
        Ok(value)
    });
    Ok(json!({
        "best_free_run": simulation.best,
        "longest_time_constant_s": simulation.longest_time_constant_s,
        "period_s": simulation.period_s,
        "refined": refined.transpose()?,
        "subspace": simulation.subspace.as_ref().map(figures),
    }))
}

fn score(score: &Score) -> Value {
    let noise = if score.noise == Noise::Coloured { "coloured" } else { "white" };
    json!({ "start": score.start, "noise": noise, "free_run": finite(score.error) })
}

fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

fn mode(deviation: &ModeDeviation) -> Value {
    let mode = &deviation.mode;
    json!({
        "hz": mode.hz, "hz_std": deviation.hz_std, "damping_ratio": mode.damping, "damping_ratio_std": deviation.damping_std,
        "kind": mode.kind, "stable": mode.stable, "strength_db": finite(mode.strongest_db()),
    })
}

pub(crate) fn pretty(value: &Value) -> String {
    let mut text = serde_json::to_string_pretty(value).expect("JSON values are JSON");
    text.push('\n');
    text
}

/// Returns the rows k, e_1, ..., e_p over all records, with k continuing from one record to the next; the cell of a
/// missing sample is empty.
fn innovations(outcome: &Outcome) -> String {
    let p = outcome.form.indices().len();
    let mut text = String::from("k");
    for i in 1..=p {
        let _ = write!(text, ",e_{i}");
    }
    text.push('\n');
    let rows = outcome.validation.innovations.iter().flat_map(|record| record.rows());
    for (k, row) in rows.enumerate() {
        let _ = write!(text, "{k}");
        for e in row {
            text.push(',');
            if e.is_finite() {
                let _ = write!(text, "{e}");
            }
        }
        text.push('\n');
    }
    text
}

/// Returns the means recorded in `result.json` and in the model's provenance; the model applies to deviations from
/// them.
fn operating_point(outcome: &Outcome) -> Value {
    let prepared = &outcome.prepared;
    let record = prepared.records.len() - 1;
    let offsets = |side: usize| prepared.lines[record][side].iter().map(|line| line.offset).collect::<Vec<_>>();
    json!({ "inputs": offsets(0), "outputs": offsets(1) })
}

fn with_provenance(outcome: &Outcome) -> Model {
    let mut provenance = Map::new();
    provenance.insert("program".into(), json!(format!("plid {}", env!("CARGO_PKG_VERSION"))));
    provenance.insert("experiment".into(), json!(outcome.experiment.name));
    provenance.insert("operating_point".into(), operating_point(outcome));
    provenance.insert("input_advanced_by".into(), json!(outcome.prepared.advanced));
    provenance.insert("predictor".into(), json!(outcome.predictor));
    Model { provenance: Some(provenance), ..outcome.model.clone() }
}

/// Returns the reason for the choice of the covariance form.
fn reason(conditions: &Conditions) -> String {
    let Conditions { states, steps, start_ratio, forgets, .. } = conditions;
    let scalar = json!(conditions.scalar);
    let scalar = scalar.as_str().unwrap_or_default();
    let forgetting = if *forgets { "" } else { "no " };
    format!(
        "the recommendation for {scalar}, {states} states, {steps} steps, P0/R = {start_ratio:.1e}, \
         {forgetting}forgetting"
    )
}

fn manifest(outcome: &Outcome) -> Value {
    json!({
        "program": "plid",
        "version": env!("CARGO_PKG_VERSION"),
        "identity_sha256": outcome.identity,
        "experiment": outcome.experiment,
        "covariance_form": {
            "name": outcome.experiment.variant.covariance,
            "chosen_by": outcome.chosen.as_ref().map_or("the experiment".into(), reason),
        },
        "experiment_toml": to_toml(&outcome.experiment),
        "files": outcome.sources,
        "preparation": outcome.steps,
        "warnings": outcome.warnings,
    })
}

pub(crate) fn errors(errors: &Errors) -> Value {
    json!({
        "relative": errors.relative,
        "overall_relative": errors.overall_relative,
        "rms": errors.rms_error,
        "fit_percent": errors.fit_percent,
    })
}

/// Returns the modes of a canonical model with their standard deviations.
pub(crate) fn modes_json(canonical: &Model) -> Result<Value, RunError> {
    Ok(mode_deviations(canonical)?.iter().map(mode).collect())
}

/// Returns the peaks of a model and of the true plant.
pub(crate) fn peaks_json(peaks: &[PeakRow]) -> Value {
    let row = |row: &PeakRow| {
        json!({ "mode_hz": row.mode_hz, "input": row.input, "output": row.output, "truth_hz_db": row.truth, "model_hz_db": row.model,
                "frequency_error_relative": row.frequency_error(), "height_error_db": row.height_error_db() })
    };
    peaks.iter().map(row).collect()
}

/// Returns the content of result.json.
fn result(outcome: &Outcome) -> Result<Value, RunError> {
    let validation = &outcome.validation;
    let record = &outcome.prepared.records[outcome.prepared.records.len() - 1];
    let states: usize = outcome.form.indices().iter().sum();
    let tests = |c: &plid_model::signal::Correlation| {
        json!({ "statistic": c.test.statistic, "degrees_of_freedom": c.test.degrees_of_freedom,
                "p_value": c.test.p_value, "passes": c.test.passes, "lags_outside": c.test.outside })
    };
    let bank: Vec<Value> = outcome.bank.iter().map(|trial| json!(trial)).collect();
    Ok(json!({
        "name": outcome.experiment.name,
        "variant": outcome.experiment.variant,
        "sample_rate_hz": record.sample_rate_hz,
        "inputs": record.input_names,
        "outputs": record.output_names,
        "states": states,
        "observability_indices": outcome.form.indices(),
        "joint_states": states * (record.input_names.len() + record.output_names.len() + 1),
        "training_samples": outcome.prepared.training.iter().sum::<usize>(),
        "held_out_samples": validation.measured.nrows() - validation.training,
        "input_advanced_by": outcome.prepared.advanced,
        "input_advance_test": outcome.prepared.advance_test,
        "operating_point": operating_point(outcome),
        "held_out": {
            "one_step": validation.one_step_errors.as_ref().map(errors),
            "free_run": errors(&validation.free_run_errors),
            "free_run_of_the_true_plant": validation.truth_errors.as_ref().map(errors),
            "noise_floor_relative": validation.noise_floor,
        },
        "simulation": simulation(outcome)?,
        "predictor": outcome.predictor,
        "estimate": outcome.estimate,
        "noise": {
            "of_channels_divided_by": { "inputs": outcome.prepared.input_scales, "outputs": outcome.prepared.output_scales },
            "sensor_variances": outcome.noise_levels.0, "mean_state_variance": outcome.noise_levels.1, "bank": bank,
        },
        "order_scan": outcome.scan,
        "index_search": outcome.index_search,
        "modes": modes_json(&outcome.canonical)?,
        "peaks": peaks_json(&outcome.peaks),
        "residual_whiteness": validation.whiteness.iter().map(tests).collect::<Vec<_>>(),
        "residual_input_correlation":
            validation.cross.iter().map(|row| row.iter().map(tests).collect::<Vec<_>>()).collect::<Vec<_>>(),
        "covariance_health": {
            "smallest_pivot": outcome.health.smallest_pivot, "index": outcome.health.index,
            "symmetry_defect": outcome.health.symmetry_defect, "condition_at_least": outcome.health.condition,
        },
        "warnings": outcome.warnings,
        "advice": outcome.advice,
    }))
}
