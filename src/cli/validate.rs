//! `plid validate`: models beside each other on records, as MATLAB's `compare`.

use std::path::PathBuf;

use ndarray::{Array2, s};
use plid::lab::data::{self, Table};
use plid::lab::model::{
    CompareOptions, Comparison, Model, NamedModel, OutputScore, Record, Run, Start, compare, estimate_initial_state,
    simulate,
};
use plid::lab::report::{self, Cell, Report, Trace, trace_plot, write_atomic};

use super::{Failure, Voice, check_directory, table};

/// Put one or more models beside each other on records: in free run, and one step ahead where a model has a predictor gain.
///
/// The state at the start of a record is fitted to it, or zero with --start rest. Means of the record's channels are removed,
/// since a linear model has no place for them, unless --keep-means is given. Fit is 100 (1 - |y - y_model| / |y - mean y|).
#[derive(clap::Args)]
#[command(
    after_help = "Example:\n  plid validate --model a/model.json --model b/model.json record.csv --out out/compare"
)]
pub struct Arguments {
    /// A model.json; may be given several times.
    #[arg(long = "model", value_name = "FILE", required = true)]
    models: Vec<PathBuf>,
    /// Data files with the models' channels as columns.
    #[arg(required = true)]
    data: Vec<PathBuf>,
    /// The state at the start of each record.
    #[arg(long, default_value = "fitted", value_parser = ["fitted", "rest"])]
    start: String,
    /// Samples at the start that are not scored.
    #[arg(long, value_name = "N", default_value_t = 0)]
    skip: usize,
    /// Samples a second; left out, the file's own, or without one the model's.
    #[arg(long, value_name = "HZ")]
    rate: Option<f64>,
    /// Take the channels as they are.
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
        check_directory(out, arguments.force)?;
    }
    let names: Vec<String> = arguments.models.iter().map(|path| path.display().to_string()).collect();
    let models = arguments.models.iter().map(|path| Model::read(path)).collect::<Result<Vec<_>, _>>()?;
    let named: Vec<NamedModel<'_>> =
        names.iter().zip(&models).map(|(name, model)| NamedModel { name, model }).collect();
    let tables = arguments.data.iter().map(|path| table::read(path)).collect::<Result<Vec<Table>, _>>()?;
    let mut values = Vec::new();
    let mut rates = Vec::new();
    for table in &tables {
        let (rate, assumed) = data::sample_rate(table, arguments.rate)?;
        // A file that does not say its rate is taken to be at the model's.
        rates.push(if assumed.is_some() { models[0].sample_rate_hz } else { rate });
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
    if voice.json {
        println!("{json}");
    } else if !voice.quiet {
        print(&comparison);
    }
    if let Some(out) = &arguments.out {
        let page = page(&comparison, &named, &records, start)?;
        std::fs::create_dir_all(out)
            .and_then(|()| write_atomic(&out.join("report.html"), page.as_bytes()))
            .and_then(|()| write_atomic(&out.join("result.json"), format!("{json}\n").as_bytes()))
            .map_err(|e| Failure::work(format!("{}: {e}", out.display())))?;
    }
    Ok(())
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

fn fit(score: &OutputScore) -> String {
    score.fit_percent.map_or("-".into(), |fit| format!("{fit:.2}"))
}

fn percent(value: Option<f64>) -> String {
    value.map_or("-".into(), |x| format!("{:.3}", 100.0 * x))
}

fn print(comparison: &Comparison) {
    println!("fit, % (100 is perfect), and RMS of the error over RMS of the output, %");
    for trial in &comparison.trials {
        println!("{} on {}", trial.model, trial.record);
        for (kind, run) in [("free run", Some(&trial.free_run)), ("one-step", trial.one_step.as_ref())] {
            match run {
                None => {}
                Some(Run::Diverged { output, sample }) => {
                    println!("  {kind}: diverges ({output}, sample {sample})");
                }
                Some(Run::Scored { outputs, relative_rms }) => {
                    for score in outputs {
                        let relative = percent(score.relative_rms);
                        println!("  {kind}  {:<20} fit {:>8}   error {relative:>8}", score.output, fit(score));
                    }
                    println!("  {kind}  {:<20} {:>12}   error {:>8}", "all", "", percent(*relative_rms));
                }
            }
        }
    }
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
            report = report.verdict(if overall(&trial.free_run).is_finite() {
                format!(
                    "On {}, {} simulates best: its free run is off by {} % (RMS of the error over RMS of the output).",
                    record.name,
                    trial.model,
                    percent(Some(overall(&trial.free_run)))
                )
            } else {
                format!("On {} every model diverges.", record.name)
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
            unit: "data's unit".into(),
            measured,
            predicted: None,
            free_run: Some(free_run),
        })
        .collect();
    Some(trace_plot(&traces, record.sample_rate_hz, window))
}
