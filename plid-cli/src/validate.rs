//! `plid validate`: a comparison of models on records, like MATLAB's `compare`.

use std::path::{Path, PathBuf};

use ndarray::{Array2, s};
use plid::lab::data::{self, MissingPolicy, Table};
use plid::lab::report::{self, Cell, Report, Trace, percent, trace_plot};
use plid::model::{
    CompareOptions, Comparison, Model, NamedModel, OutputScore, Record, Run, Start, Trial, compare,
    estimate_initial_state, simulate,
};

use plid_file::{Staged, to_json, to_value, write_atomic};

use super::{Failure, Voice, directory, table, voice};

/// Compare models on records: in free run, and one step ahead if a model has a predictor gain.
///
/// The initial state of each record is fitted, or zero with --start rest. The mean of each channel is removed unless
/// --keep-means is given. Fit is 100 (1 - |y - y_model| / |y - mean y|).
#[derive(clap::Args)]
#[command(
    after_help = "Example:\n  plid validate --model a/model.json --model b/model.json record.csv --out out/compare"
)]
pub struct Arguments {
    /// A model.json. May be repeated.
    #[arg(long = "model", value_name = "FILE", required = true)]
    models: Vec<PathBuf>,
    /// Data files with the models' channels as columns.
    #[arg(required = true)]
    data: Vec<PathBuf>,
    /// Initial state of each record.
    #[arg(long, default_value = "fitted", value_parser = ["fitted", "rest"])]
    start: String,
    /// Number of initial samples that are not scored.
    #[arg(long, value_name = "N", default_value_t = 0)]
    skip: usize,
    /// Sample rate [default: that of the file, or else of the model].
    #[arg(long, value_name = "HZ")]
    rate: Option<f64>,
    /// Do not remove the mean of each channel.
    #[arg(long)]
    keep_means: bool,
    /// Also write DIR/report.html and DIR/result.json.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Write into a directory that is not empty.
    #[arg(long)]
    force: bool,
}

/// This file is written last, so that its presence shows that the report exists.
const RESULT: &str = "result.json";

/// Number of samples of the traces in the report.
const WINDOW: usize = 400;

/// Runs the command.
pub fn execute(arguments: Arguments, voice: Voice) -> Result<(), Failure> {
    if let Some(out) = &arguments.out {
        directory::check(out, arguments.force)?;
    }
    let names: Vec<String> = arguments.models.iter().map(|path| path.display().to_string()).collect();
    let models = arguments.models.iter().map(|path| Model::read(path)).collect::<Result<Vec<_>, _>>()?;
    let named: Vec<NamedModel<'_>> =
        names.iter().zip(&models).map(|(name, model)| NamedModel { name, model }).collect();
    let tables = arguments.data.iter().map(|path| read(path, &arguments, &models)).collect::<Result<Vec<_>, _>>()?;
    let paths = arguments.data.iter();
    let records: Vec<Record<'_>> = paths
        .zip(&tables)
        .map(|(path, (table, rate))| Record {
            name: path.to_str().unwrap_or("record"),
            sample_rate_hz: *rate,
            channels: &table.names,
            values: table.columns.view(),
        })
        .collect();
    let start = if arguments.start == "rest" { Start::Rest } else { Start::Fitted { window: None } };
    let comparison = compare(&named, &records, CompareOptions { start, score_from: arguments.skip })?;
    let json = to_value(&comparison).and_then(|value| to_json(&value)).map_err(Failure::work)?;
    // The files are written first, because the reader of the table may close the pipe before its end.
    if let Some(out) = &arguments.out {
        let page = page(&comparison, &named, &records, start);
        directory::with(out, || write(out, &page, &json).map_err(|error| Failure::file(out, &error)))?;
    }
    if voice.json {
        voice::print(&json)
    } else if voice.quiet {
        Ok(())
    } else {
        voice::print(&printed(&comparison, &names))
    }
}

/// Reads a record and its sample rate (Hz), and checks that it has the channels of every model.
fn read(path: &Path, arguments: &Arguments, models: &[Model]) -> Result<(Table, f64), Failure> {
    let mut table = table::read(path)?;
    let rate = table::rate(&table, arguments.rate, models[0].sample_rate_hz)?;
    for model in models {
        // An error in a channel is reported with file and line.
        data::extract(&table, &model.inputs, &model.outputs, Some(model.sample_rate_hz), MissingPolicy::Nan)?;
    }
    if !arguments.keep_means {
        remove_means(&mut table.columns);
    }
    Ok((table, rate))
}

fn remove_means(columns: &mut Array2<f64>) {
    for mut column in columns.columns_mut() {
        let present: Vec<f64> = column.iter().copied().filter(|x| x.is_finite()).collect();
        let mean = present.iter().sum::<f64>() / present.len().max(1) as f64;
        column.mapv_inplace(|x| x - mean);
    }
}

/// Writes both files or neither.
fn write(out: &Path, page: &str, json: &str) -> std::io::Result<()> {
    let staged = Staged::new(out)?;
    write_atomic(&staged.path().join("report.html"), page.as_bytes())?;
    write_atomic(&staged.path().join(RESULT), json.as_bytes())?;
    staged.commit(RESULT, &[])
}

/// Returns the table for standard output, with one row per output and a pair of columns per model.
fn printed(comparison: &Comparison, models: &[String]) -> String {
    let mut text = String::from("fit: 100 is perfect; error: RMS of the error over RMS of the output\n");
    for (k, model) in models.iter().enumerate() {
        text += &format!("  [{}] {model}\n", k + 1);
    }
    for trials in comparison.trials.chunks(models.len()) {
        text += &format!("\n{}\n  {:<9} {:<20}", trials[0].record, "", "");
        text.extend((1..=models.len()).map(|k| format!("{:>21}", format!("[{k}] fit %     error"))));
        text.push('\n');
        let free_runs: Vec<Option<&Run>> = trials.iter().map(|trial| Some(&trial.free_run)).collect();
        let one_steps: Vec<Option<&Run>> = trials.iter().map(|trial| trial.one_step.as_ref()).collect();
        text += &rows("free run", &free_runs);
        text += &rows("one-step", &one_steps);
    }
    text
}

/// Returns the rows of one kind of run. `runs` has one entry per model, which is `None` if the model has no such run.
fn rows(kind: &str, runs: &[Option<&Run>]) -> String {
    if runs.iter().all(Option::is_none) {
        return String::new();
    }
    let scores = |run: &Option<&Run>| -> Vec<OutputScore> {
        match run {
            Some(Run::Scored { outputs, .. }) => outputs.clone(),
            _ => Vec::new(),
        }
    };
    let scores: Vec<Vec<OutputScore>> = runs.iter().map(scores).collect();
    // Models need not have the same outputs.
    let mut outputs: Vec<&String> = Vec::new();
    for score in scores.iter().flatten() {
        if !outputs.contains(&&score.output) {
            outputs.push(&score.output);
        }
    }
    let mut text = String::new();
    for output in outputs {
        text += &format!("  {kind:<9} {output:<20}");
        for scores in &scores {
            let score = scores.iter().find(|score| &score.output == output);
            let fit = score.and_then(|s| s.fit_percent).map_or("–".into(), |fit| format!("{fit:.2}"));
            text += &format!("{fit:>11}{:>10}", percent(score.and_then(|s| s.relative_rms).unwrap_or(f64::NAN)));
        }
        text.push('\n');
    }
    text += &format!("  {kind:<9} {:<20}", "all");
    for run in runs {
        let error = match run {
            Some(Run::Scored { relative_rms, .. }) => percent(relative_rms.unwrap_or(f64::NAN)),
            Some(Run::Diverged { sample, .. }) => format!("diverges at {sample}"),
            None => "–".into(),
        };
        text += &format!("{error:>21}");
    }
    text.push('\n');
    text
}

fn page(comparison: &Comparison, models: &[NamedModel<'_>], records: &[Record<'_>], start: Start) -> String {
    let mut report = Report::new("Comparison of the models");
    for record in records {
        let trials = comparison.trials.iter().filter(|trial| trial.record == record.name);
        if let Some(best) = trials.min_by(|a, b| overall(&a.free_run).total_cmp(&overall(&b.free_run))) {
            report = report.verdict(verdict(best, models.len() == 1));
        }
    }
    for record in records {
        for named in models {
            if let Some(figure) = traces(named, record, start) {
                report = report.figure(
                    figure,
                    format!("{} on {}: measured and simulated in free run; the error below.", named.name, record.name),
                );
            }
        }
    }
    report.table(scores(comparison)).provenance("plid", env!("CARGO_PKG_VERSION")).to_html()
}

/// RMS of the error over RMS of the output; infinite where the model diverges.
fn overall(run: &Run) -> f64 {
    match run {
        Run::Scored { relative_rms, .. } => relative_rms.unwrap_or(f64::INFINITY),
        Run::Diverged { .. } => f64::INFINITY,
    }
}

/// Returns the sentence about the best simulation of a record.
fn verdict(best: &Trial, alone: bool) -> String {
    let error = overall(&best.free_run);
    if !error.is_finite() {
        return format!("On {} {}.", best.record, if alone { "the model diverges" } else { "every model diverges" });
    }
    format!(
        "On {}, {}{} is off by {} (RMS of the error over RMS of the output).",
        best.record,
        best.model,
        if alone { " in free run" } else { " simulates best: its free run" },
        percent(error)
    )
}

/// Returns the table of the page, with a row for every output of every run.
fn scores(comparison: &Comparison) -> report::Table {
    let mut table = report::Table::new("Fit as MATLAB's compare, and RMS of the error over RMS of the output.")
        .column("record", "")
        .column("model", "")
        .column("run", "")
        .column("output", "")
        .column("fit", "%")
        .column("error", "%");
    for trial in &comparison.trials {
        for (kind, run) in [("free run", Some(&trial.free_run)), ("one-step", trial.one_step.as_ref())] {
            let begin = || -> [Cell; 3] { [trial.record.clone().into(), trial.model.clone().into(), kind.into()] };
            match run {
                None => {}
                Some(Run::Diverged { output, sample }) => {
                    table =
                        table.row(begin().into_iter().chain([format!("{output} diverges at sample {sample}").into()]));
                }
                Some(Run::Scored { outputs, .. }) => {
                    for score in outputs {
                        table = table.row(begin().into_iter().chain([
                            score.output.clone().into(),
                            Cell::fixed(score.fit_percent.unwrap_or(f64::NAN), 2),
                            Cell::significant(100.0 * score.relative_rms.unwrap_or(f64::NAN), 3),
                        ]));
                    }
                }
            }
        }
    }
    table
}

/// Plots the last samples of a record. Returns `None` if the model diverges, or if gaps in the record prevent a fit
/// of its state.
fn traces(named: &NamedModel<'_>, record: &Record<'_>, start: Start) -> Option<String> {
    let model = named.model;
    let column = |name: &String| record.channels.iter().position(|c| c == name);
    let pick = |names: &[String]| -> Option<Array2<f64>> {
        let places: Option<Vec<usize>> = names.iter().map(column).collect();
        Some(record.values.select(ndarray::Axis(1), &places?))
    };
    let (inputs, outputs) = (pick(&model.inputs)?, pick(&model.outputs)?);
    let x0 = match start {
        Start::Rest => model.rest(),
        Start::Fitted { window } => estimate_initial_state(model, inputs.view(), outputs.view(), window).ok()?.state,
    };
    let simulated = simulate(model, inputs.view(), &x0).ok()?.outputs;
    let samples = outputs.nrows();
    let window = samples.saturating_sub(WINDOW)..samples;
    let columns: Vec<[Vec<f64>; 2]> = (0..model.p())
        .map(|i| [&outputs, &simulated].map(|array| array.slice(s![window.clone(), i]).to_vec()))
        .collect();
    let traces: Vec<Trace<'_>> = columns
        .iter()
        .zip(&model.outputs)
        .map(|([measured, free_run], name)| Trace {
            name: name.clone(),
            unit: String::new(),
            measured,
            predicted: None,
            free_run: Some(free_run),
        })
        .collect();
    Some(trace_plot(&traces, record.sample_rate_hz, window))
}
