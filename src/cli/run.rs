//! `plid run`: an experiment from its file to its report.

use std::path::{Path, PathBuf};

use plid::lab::experiment::{self, Experiment};
use plid::lab::run::{self, Outcome};

use super::progress::Bar;
use super::{Failure, Voice, check_directory};

/// Carry out an experiment: obtain the data, identify, validate on held-out data, report.
///
/// Writes DIR/report.html (open it in a browser; its first picture also as frf.svg), result.json (the figures), model.json (the model), innovations.csv and
/// manifest.json (every default, and the hashes of the input files). The same experiment gives the same bytes. Ctrl-C leaves a
/// checkpoint, from which --resume goes on to the same result.
#[derive(clap::Args)]
#[command(
    after_help = "Example:\n  plid run experiments/truss-mimo-30.toml --out out/truss\n\nThe shortest experiment file for data of your own:\n  [data]\n  files = [\"record.csv\"]\n  inputs = [\"force\"]\n  outputs = [\"left\", \"right\"]\n  [structure]\n  states = 8"
)]
pub struct Arguments {
    /// The experiment, a TOML file; the paths in it are relative to it.
    experiment: PathBuf,
    /// Where the results go; out/NAME if left out.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Go on from the checkpoint of an interrupted run in the output directory.
    #[arg(long)]
    resume: bool,
    /// Write into a directory that is not empty.
    #[arg(long)]
    force: bool,
}

/// Runs the command.
pub fn execute(arguments: Arguments, voice: Voice) -> Result<(), Failure> {
    let path = &arguments.experiment;
    let experiment = experiment::read(path).map_err(plid::lab::run::RunError::from)?;
    let base = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let out = arguments.out.unwrap_or_else(|| Path::new("out").join(&experiment.name));
    check_directory(&out, arguments.force || arguments.resume)?;
    carry_out(&experiment, base, &out, arguments.resume, voice)
}

/// Carries out an experiment and says in short what came of it.
pub fn carry_out(experiment: &Experiment, base: &Path, out: &Path, resume: bool, voice: Voice) -> Result<(), Failure> {
    let bar = Bar::new(voice.quiet || voice.json);
    let result = run::carry_out(experiment, base, Some(out), resume, &bar);
    bar.finish();
    let outcome = result?;
    run::write(&outcome, out)?;
    if voice.json {
        let path = out.join("result.json");
        let text = std::fs::read_to_string(&path).map_err(|e| Failure::work(format!("{}: {e}", path.display())))?;
        print!("{text}");
    } else if !voice.quiet {
        say(&outcome, out);
    }
    Ok(())
}

fn say(outcome: &Outcome, out: &Path) {
    let validation = &outcome.validation;
    println!("{} states, observability indices {:?}", outcome.model.n(), outcome.form.indices());
    println!("held-out errors, RMS over RMS of the output:");
    println!("  {:<20} {:>10} {:>10}", "output", "one-step", "free run");
    let percent = |value: Option<f64>| match value {
        Some(value) if value.is_finite() => format!("{:.3} %", 100.0 * value),
        Some(_) => "diverges".into(),
        None => "-".into(),
    };
    let one_step = validation.one_step_errors.as_ref();
    let free_run = &validation.free_run_errors;
    for (i, name) in outcome.model.outputs.iter().enumerate() {
        let row = (percent(one_step.map(|e| e.relative[i])), percent(Some(free_run.relative[i])));
        println!("  {name:<20} {:>10} {:>10}", row.0, row.1);
    }
    let overall = (percent(one_step.map(|e| e.overall_relative)), percent(Some(free_run.overall_relative)));
    println!("  {:<20} {:>10} {:>10}", "all", overall.0, overall.1);
    if let Some(truth) = &validation.truth_errors {
        println!("  {:<20} {:>10} {:>10}", "true plant", "", percent(Some(truth.overall_relative)));
    }
    for warning in &outcome.warnings {
        eprintln!("warning: {warning}");
    }
    for advice in &outcome.advice {
        eprintln!("advice: {advice}");
    }
    println!("report: {}", out.join("report.html").display());
}
