//! `plid validate`: models beside each other on records, as MATLAB's `compare`.

use std::path::PathBuf;

use ndarray::{Array2, s};
use plid::lab::data::{self, MissingPolicy, Table};
use plid::lab::report::{self, Cell, Report, Trace, trace_plot, write_atomic};
use plid::model::{
    CompareOptions, Comparison, Model, NamedModel, OutputScore, Record, Run, Start, compare, estimate_initial_state,
    simulate,
};

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

/// Samples of the traces in the report.
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
    let tables = arguments.data.iter().map(|path| table::read(path)).collect::<Result<Vec<Table>, _>>()?;
    let mut values = Vec::new();
    let mut rates = Vec::new();
    for table in &tables {
        rates.push(table::rate(table, arguments.rate, models[0].sample_rate_hz)?);
        for model in &models {
            // What is wrong with a channel is said with file and line.
            data::extract(table, &model.inputs, &model.outputs, Some(model.sample_rate_hz), MissingPolicy::Nan)?;
        }
        values.push(if arguments.keep_means { table.columns.clone() } else { without_means(&table.columns) });
    }
    let records: Vec<Record<'_>> = tables
        .iter()
        .zip(&values)
        .zip(&rates)
        .zip(&arguments.data)
        .map(|(((table, values), &rate), path)| Record {
            name: path.to_str().unwrap_or("record"),
            sample_rate_hz: rate,
            channels: &table.names,
            values: values.view(),
        })
        .collect();
    let start = if arguments.start == "rest" { Start::Rest } else { Start::Fitted { window: None } };
    let comparison = compare(&named, &records, CompareOptions { start, score_from: arguments.skip })?;
    let json = serde_json::to_string_pretty(&comparison).map_err(Failure::work)?;
    // The files come first: a reader of the table may be gone before its end.
    if let Some(out) = &arguments.out {
        let page = page(&comparison, &named, &records, start)?;
        let files = [("report.html", page), ("result.json", format!("{json}\n"))];
        directory::with(out, || {
            files.iter().try_for_each(|(name, text)| {
                let path = out.join(name);
                write_atomic(&path, text.as_bytes()).map_err(|error| Failure::file(&path, &error))
            })
        })?;
    }
    if voice.json {
        voice::print(&format!("{json}\n"))
    } else if voice.quiet {
        Ok(())
    } else {
        voice::print(&beside(&comparison, &names))
    }
}

fn without_means(columns: &Array2<f64>) -> Array2<f64> {
    let mut values = columns.clone();
    for mut column in values.columns_mut() {
        let present: Vec<f64> = column.iter().copied().filter(|x| x.is_finite()).collect();
        let mean = present.iter().sum::<f64>() / present.len().max(1) as f64;
        column.mapv_inplace(|x| x - mean);
    }
    values
}

fn percent(value: Option<f64>) -> String {
    value.map_or("-".into(), |x| format!("{:.3}", 100.0 * x))
}

/// The table on standard output: a row an output, a pair of columns a model.
fn beside(comparison: &Comparison, models: &[String]) -> String {
    let mut text = String::from("fit: 100 is perfect; error: RMS of the error over RMS of the output\n");
    for (k, model) in models.iter().enumerate() {
        text += &format!("  [{}] {model}\n", k + 1);
    }
    for trials in comparison.trials.chunks(models.len()) {
        text += &format!("\n{}\n  {:<9} {:<20}", trials[0].record, "", "");
        text.extend((1..=models.len()).map(|k| format!("{:>21}", format!("[{k}] fit %   error %"))));
        text.push('\n');
        let free_runs: Vec<Option<&Run>> = trials.iter().map(|trial| Some(&trial.free_run)).collect();
        let one_steps: Vec<Option<&Run>> = trials.iter().map(|trial| trial.one_step.as_ref()).collect();
        text += &rows("free run", &free_runs);
        text += &rows("one-step", &one_steps);
    }
    text
}

/// The rows of one kind of run, one run a model; none where no model has it.
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
            let fit = score.and_then(|s| s.fit_percent).map_or("-".into(), |fit| format!("{fit:.2}"));
            text += &format!("{fit:>11}{:>10}", percent(score.and_then(|s| s.relative_rms)));
        }
        text.push('\n');
    }
    text += &format!("  {kind:<9} {:<20}", "all");
    for run in runs {
        let error = match run {
            Some(Run::Scored { relative_rms, .. }) => percent(*relative_rms),
            Some(Run::Diverged { sample, .. }) => format!("diverges at {sample}"),
            None => "-".into(),
        };
        text += &format!("{error:>21}");
    }
    text.push('\n');
    text
}

fn page(
    comparison: &Comparison,
    models: &[NamedModel<'_>],
    records: &[Record<'_>],
    start: Start,
) -> Result<String, Failure> {
    let overall = |run: &Run| match run {
        Run::Scored { relative_rms, .. } => relative_rms.unwrap_or(f64::INFINITY),
        Run::Diverged { .. } => f64::INFINITY,
    };
    let mut report = Report::new("Models beside each other");
    for record in records {
        let best = comparison
            .trials
            .iter()
            .filter(|trial| trial.record == record.name)
            .min_by(|a, b| overall(&a.free_run).total_cmp(&overall(&b.free_run)));
        if let Some(trial) = best {
            let best = if models.len() > 1 { " simulates best: its free run" } else { " in free run" };
            report = report.verdict(if overall(&trial.free_run).is_finite() {
                format!(
                    "On {}, {}{best} is off by {} % (RMS of the error over RMS of the output).",
                    record.name,
                    trial.model,
                    percent(Some(overall(&trial.free_run)))
                )
            } else {
                format!(
                    "On {} {}.",
                    record.name,
                    if models.len() > 1 { "every model diverges" } else { "the model diverges" }
                )
            });
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
    Ok(report.table(table).provenance("plid", env!("CARGO_PKG_VERSION")).to_html())
}

/// The last samples of a record; none where the model diverges or the record has gaps that keep its state from being fitted.
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
    let columns: Vec<[Vec<f64>; 2]> =
        (0..model.p()).map(|i| [&outputs, &simulated].map(|array| array.slice(s![.., i]).to_vec())).collect();
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
