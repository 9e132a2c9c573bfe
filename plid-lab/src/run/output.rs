//! The output files of a run: result.json, model.json, model-refined.json, model-subspace.json, innovations.csv,
//! manifest.json, report.html and its first figure, frf.svg. Each is written atomically. The same run gives the same
//! bytes, because no file contains a time or an absolute path.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use plid_refine::{Noise, Score};
use serde::Serialize;
use serde_json::{Map, Value, json};

use super::error::RunError;
use super::validate::Errors;
use super::{Alternative, CHECKPOINT, Outcome, PeakRow, StreamedRun, report};
use crate::experiment::to_toml;
use plid_catalogue::Conditions;
use plid_file::{Staged, to_json, to_value, write_atomic};
use plid_model::{ModeDeviation, Model, mode_deviations};

/// The file that is written last, so that its presence shows that the other files are complete.
pub(crate) const RESULT: &str = "result.json";

/// The file that describes a run, with every default filled in.
pub(crate) const MANIFEST: &str = "manifest.json";

const REFINED: &str = "model-refined.json";
const SUBSPACE: &str = "model-subspace.json";

/// Writes all files of a run into `directory`. Together they replace those of an earlier run, and its checkpoint is
/// removed. If anything fails, the earlier run remains unchanged.
///
/// # Errors
/// Returns an error if a file cannot be written or a frequency response cannot be computed.
pub fn write(outcome: &Outcome, directory: &Path) -> Result<(), RunError> {
    let staged = Staged::new(directory).map_err(file_error(directory))?;
    let put = |name: &str, bytes: &[u8]| {
        write_atomic(&staged.path().join(name), bytes).map_err(file_error(&directory.join(name)))
    };
    let json = |name: &str, value: &Value| put(name, strict_json(&directory.join(name), value)?.as_bytes());
    let (page, responses) = report::page(outcome)?;
    let name = "innovations.csv";
    innovations(outcome, &staged.path().join(name)).map_err(file_error(&directory.join(name)))?;
    with_provenance(outcome).write(&staged.path().join("model.json"))?;
    simulation_models(outcome, staged.path())?;
    json(MANIFEST, &manifest(outcome, &directory.join(MANIFEST))?)?;
    put("frf.svg", responses.as_bytes())?;
    put("report.html", page.as_bytes())?;
    json(RESULT, &result(outcome, &directory.join(RESULT))?)?;
    staged.commit(RESULT, &[REFINED, SUBSPACE, CHECKPOINT]).map_err(file_error(directory))
}

/// Returns the error of a file.
pub(crate) fn file_error(path: &Path) -> impl FnOnce(std::io::Error) -> RunError {
    move |source| RunError::File { path: path.into(), source }
}

/// Returns the value of `key` in the JSON file `path`; a field that is `None` has no key.
pub(crate) fn typed<T: Serialize + ?Sized>(path: &Path, key: &str, value: &T) -> Result<Value, RunError> {
    to_value(value).map_err(|mut source| {
        source.path = format!("{key}.{}", source.path);
        RunError::NotFinite { path: path.into(), source }
    })
}

/// Returns the text of a JSON file.
pub(crate) fn strict_json(path: &Path, value: &Value) -> Result<String, RunError> {
    to_json(value).map_err(|source| RunError::NotFinite { path: path.into(), source })
}

/// Writes the models for simulation into `folder`.
fn simulation_models(outcome: &Outcome, folder: &Path) -> Result<(), RunError> {
    let simulation = &outcome.simulation;
    let refined = simulation.refined.as_ref().filter(|_| !simulation.refined_is_worse).map(|(model, _)| model);
    for (name, alternative) in [(REFINED, refined), (SUBSPACE, simulation.subspace.as_ref())] {
        let Some(alternative) = alternative else { continue };
        let provenance = with_provenance(outcome).provenance.map(|mut provenance| {
            provenance.remove("predictor");
            if let Some(error) = finite(alternative.free_run_errors.overall_relative) {
                provenance.insert("held_out_free_run".into(), json!(error));
            }
            provenance
        });
        Model { provenance, ..alternative.model.clone() }.write(&folder.join(name))?;
    }
    Ok(())
}

/// Returns the figures of the additional models for simulation, `refined` and `subspace`.
fn simulation(outcome: &Outcome) -> Result<Value, RunError> {
    let simulation = &outcome.simulation;
    let outputs = &outcome.model.outputs;
    let figures = |model: &Alternative| {
        let value = json!({ "free_run": errors(&model.free_run_errors, outputs) });
        with(value, [("one_step", model.one_step_errors.as_ref().map(|e| errors(e, outputs)))])
    };
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
    Ok(with(
        json!({ "best_free_run": simulation.best }),
        [
            ("longest_time_constant_s", number(simulation.longest_time_constant_s)),
            ("period_s", simulation.period_s.map(|s| json!(s))),
            ("refined", refined.transpose()?),
            ("subspace", simulation.subspace.as_ref().map(figures)),
        ],
    ))
}

/// Adds to an object the keys that have a value; a key without one is absent.
pub(crate) fn with<const N: usize>(mut object: Value, optional: [(&str, Option<Value>); N]) -> Value {
    for (key, value) in optional {
        if let Some(value) = value {
            object[key] = value;
        }
    }
    object
}

/// Returns the score of a start. The noise is absent if the start was not refined.
fn score(score: &Score) -> Value {
    let noise = score.noise.map(|noise| json!(if noise == Noise::Coloured { "coloured" } else { "white" }));
    with(json!({ "start": score.start }), [("noise", noise), ("free_run", number(score.error))])
}

fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

/// Returns a number, or `None` for one that is not finite.
fn number(value: f64) -> Option<Value> {
    finite(value).map(|value| json!(value))
}

fn mode(deviation: &ModeDeviation) -> Value {
    let mode = &deviation.mode;
    let value = json!({ "kind": mode.kind, "stable": mode.stable });
    with(
        value,
        [
            // A pole at zero has no frequency.
            ("hz", number(mode.hz)),
            ("damping_ratio", number(mode.damping)),
            ("hz_std", deviation.hz_std.and_then(number)),
            ("damping_ratio_std", deviation.damping_std.and_then(number)),
            ("strength_db", number(mode.strongest_db())),
        ],
    )
}

/// Writes the rows k, e_1, ..., e_p over all records, with k continuing from one record to the next; the cell of a
/// missing sample is empty. The rows of a streamed record are those of its window.
fn innovations(outcome: &Outcome, path: &Path) -> io::Result<()> {
    let p = outcome.form.indices().len();
    let mut text = BufWriter::new(File::create(path)?);
    write!(text, "k")?;
    for i in 1..=p {
        write!(text, ",e_{i}")?;
    }
    writeln!(text)?;
    let first = outcome.streamed.as_ref().map_or(0, |streamed| streamed.first);
    let rows = outcome.validation.innovations.iter().flat_map(|record| record.rows());
    for (k, row) in rows.enumerate() {
        write!(text, "{}", first + k)?;
        for e in row {
            write!(text, ",")?;
            if e.is_finite() {
                write!(text, "{e}")?;
            }
        }
        writeln!(text)?;
    }
    text.into_inner().map_err(io::IntoInnerError::into_error)?.sync_all()
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
    if let Some(predictor) = &outcome.predictor {
        provenance.insert("predictor".into(), json!(predictor));
    }
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

fn manifest(outcome: &Outcome, path: &Path) -> Result<Value, RunError> {
    Ok(json!({
        "program": "plid",
        "version": env!("CARGO_PKG_VERSION"),
        "identity_sha256": outcome.identity,
        "experiment": typed(path, "experiment", &outcome.experiment)?,
        "covariance_form": {
            "name": outcome.experiment.variant.covariance,
            "chosen_by": outcome.chosen.as_ref().map_or("the experiment".into(), reason),
        },
        "experiment_toml": to_toml(&outcome.experiment),
        "files": typed(path, "files", &outcome.sources)?,
        "preparation": outcome.steps,
        "warnings": outcome.warnings,
    }))
}

/// Returns the error measures. A figure that does not exist has no key. This applies to the relative error of an
/// output that is zero throughout, to the fit of a constant output, and to every figure of a simulation that
/// diverges, which `diverges` states.
pub(crate) fn errors(errors: &Errors, outputs: &[String]) -> Value {
    let output = |(i, name): (usize, &String)| {
        let figures = [
            ("relative", number(errors.relative[i])),
            ("rms", number(errors.rms_error[i])),
            ("fit_percent", number(errors.fit_percent[i])),
        ];
        with(json!({ "output": name }), figures)
    };
    let outputs: Vec<Value> = outputs.iter().enumerate().map(output).collect();
    let diverges = errors.rms_error.iter().any(|x| x.is_infinite());
    let value = json!({ "diverges": diverges, "outputs": outputs });
    with(value, [("overall_relative", number(errors.overall_relative))])
}

/// Returns the modes of a canonical model with their standard deviations.
pub(crate) fn modes_json(canonical: &Model) -> Result<Value, RunError> {
    Ok(mode_deviations(canonical)?.iter().map(mode).collect())
}

/// Returns the peaks of a model and of the true plant.
pub(crate) fn peaks_json(peaks: &[PeakRow]) -> Value {
    let row = |row: &PeakRow| {
        let value = json!({
            "mode_hz": row.mode_hz, "input": row.input, "output": row.output, "truth_hz_db": row.truth,
        });
        with(
            value,
            [
                ("model_hz_db", row.model.map(|peak| json!(peak))),
                ("frequency_error_relative", row.frequency_error().map(|error| json!(error))),
                ("height_error_db", row.height_error_db().map(|error| json!(error))),
            ],
        )
    };
    peaks.iter().map(row).collect()
}

/// Returns the content of result.json.
fn result(outcome: &Outcome, path: &Path) -> Result<Value, RunError> {
    let validation = &outcome.validation;
    let record = &outcome.prepared.records[outcome.prepared.records.len() - 1];
    let states: usize = outcome.form.indices().iter().sum();
    let tests = |c: &plid_model::signal::Correlation| {
        json!({ "statistic": c.test.statistic, "degrees_of_freedom": c.test.degrees_of_freedom,
                "p_value": c.test.p_value, "passes": c.test.passes, "lags_outside": c.test.outside })
    };
    let value = json!({
        "name": outcome.experiment.name,
        "variant": typed(path, "variant", &outcome.experiment.variant)?,
        "sample_rate_hz": record.sample_rate_hz,
        "inputs": record.input_names,
        "outputs": record.output_names,
        "states": states,
        "observability_indices": outcome.form.indices(),
        "joint_states": states * (record.input_names.len() + record.output_names.len() + 1),
        "training_samples":
            outcome.streamed.as_ref().map_or_else(|| outcome.prepared.training.iter().sum::<usize>(), |s| s.training),
        "held_out_samples": validation.held_out_samples,
        "input_advanced_by": outcome.prepared.advanced,
        "operating_point": operating_point(outcome),
        "held_out": held_out(outcome),
        "simulation": simulation(outcome)?,
        "estimate": typed(path, "estimate", &outcome.estimate)?,
        "noise": {
            "of_channels_divided_by": {
                "inputs": outcome.prepared.input_scales, "outputs": outcome.prepared.output_scales,
            },
            "sensor_variances": outcome.noise_levels.0,
            "mean_state_variance": outcome.noise_levels.1,
            "bank": typed(path, "noise.bank", &outcome.bank)?,
        },
        "index_search": typed(path, "index_search", &outcome.index_search)?,
        "modes": modes_json(&outcome.canonical)?,
        "peaks": peaks_json(&outcome.peaks),
        "residual_whiteness": validation.whiteness.iter().map(tests).collect::<Vec<_>>(),
        "residual_input_correlation":
            validation.cross.iter().map(|row| row.iter().map(tests).collect::<Vec<_>>()).collect::<Vec<_>>(),
        "covariance_health": health(outcome),
        "warnings": outcome.warnings,
        "advice": outcome.advice,
    });
    let test = outcome.prepared.advance_test.as_ref();
    let advance_test = test.map(|test| typed(path, "input_advance_test", test)).transpose()?;
    let scan = outcome.scan.as_ref().map(|scan| typed(path, "order_scan", scan)).transpose()?;
    let optional = [
        ("input_advance_test", advance_test),
        ("predictor", outcome.predictor.as_ref().map(|predictor| json!(predictor))),
        ("order_scan", scan),
        ("stream", outcome.streamed.as_ref().map(|streamed| stream(streamed, &outcome.model.outputs))),
    ];
    Ok(with(value, optional))
}

/// Returns the parts of a streamed record and the errors over all its held-out samples. The other figures of a run are
/// those of the window.
fn stream(streamed: &StreamedRun, outputs: &[String]) -> Value {
    let all = json!({ "free_run": errors(&streamed.free_run, outputs) });
    json!({
        "samples": streamed.samples,
        "training_samples": streamed.training,
        "held_out_samples": streamed.samples - streamed.training,
        "window": {
            "first_sample": streamed.first,
            "training_samples": streamed.window_training,
            "held_out_samples": streamed.window_held_out,
        },
        "held_out": with(all, [("one_step", streamed.one_step.as_ref().map(|e| errors(e, outputs)))]),
    })
}

fn held_out(outcome: &Outcome) -> Value {
    let (validation, outputs) = (&outcome.validation, &outcome.model.outputs);
    let optional = |measures: &Option<Errors>| measures.as_ref().map(|measures| errors(measures, outputs));
    // An output that is zero throughout has no relative noise floor.
    let noise_floor = validation.noise_floor.as_ref().filter(|floor| floor.iter().all(|x| x.is_finite()));
    with(
        json!({ "free_run": errors(&validation.free_run_errors, outputs) }),
        [
            ("one_step", optional(&validation.one_step_errors)),
            ("free_run_of_the_true_plant", optional(&validation.truth_errors)),
            ("noise_floor_relative", noise_floor.map(|floor| json!(floor))),
        ],
    )
}

fn health(outcome: &Outcome) -> Value {
    let health = &outcome.health;
    with(
        json!({ "index": health.index }),
        [
            ("smallest_pivot", number(health.smallest_pivot)),
            ("symmetry_defect", number(health.symmetry_defect)),
            ("condition_at_least", number(health.condition)),
        ],
    )
}
