//! `plid merge`: merges finished runs with one input each into one model.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use plid::lab::experiment::Experiment;
use plid::lab::merge::{self, FinishedRun, Outcome};

use super::progress::Bar;
use super::{Failure, Voice, directory, voice};

/// Merge finished runs with one active input each into one model of all inputs.
///
/// Each RUN is the output directory of `plid run` or `plid identify`. All must have the same outputs, sample rate and
/// observability indices; their lengths and noise may differ. The estimates of A are combined, weighted by their
/// information, with the prior counted once, and each run's columns of B follow. A test decides whether the runs
/// share one A, and if not, which run differs. A run is rejected if another input acts in its record.
///
/// Writes DIR/model.json, result.json and report.html.
#[derive(clap::Args)]
#[command(
    after_help = concat!(
        "Example:\n",
        "  plid identify push.csv --inputs u1 --outputs y1,y2 --states 8 --out out/u1\n",
        "  plid identify twist.csv --inputs u2 --outputs y1,y2 --states 8 --out out/u2\n",
        "  plid merge out/u1 out/u2 --held-out both.csv --out out/merged\n",
        "\n",
        "From records to the merged model in one experiment file:\n",
        "  [data]\n",
        "  files = [\"push.csv\", \"twist.csv\"]\n",
        "  inputs = [\"u1\", \"u2\"]\n",
        "  outputs = [\"y1\", \"y2\"]\n",
        "  [structure]\n",
        "  kind = \"simo-merge\"\n",
        "  states = 8",
    )
)]
pub struct Arguments {
    /// Directories of finished runs.
    #[arg(required = true, value_name = "RUN")]
    runs: Vec<PathBuf>,
    /// Record in which all inputs act, to test the merged model. May be repeated.
    #[arg(long, value_name = "FILE")]
    held_out: Vec<PathBuf>,
    /// Leading share of such a record used to estimate the initial state; the rest is scored.
    #[arg(long, value_name = "SHARE", default_value_t = 0.25)]
    settling_share: f64,
    /// Name of the merge in the report.
    #[arg(long, default_value = "merge")]
    name: String,
    /// Output directory [default: out/NAME].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Write into a directory that is not empty.
    #[arg(long)]
    force: bool,
}

/// Runs the command.
pub fn execute(arguments: Arguments, voice: Voice) -> Result<(), Failure> {
    let share = arguments.settling_share;
    if !(share > 0.0 && share < 1.0) {
        return Err(Failure::input(format!("--settling-share {share}: give a number between 0 and 1")));
    }
    let out = arguments.out.clone().unwrap_or_else(|| directory::default_for(&arguments.name));
    directory::check(&out, arguments.force)?;
    let outcome = directory::with(&out, || {
        let runs = arguments.runs.iter().map(|run| FinishedRun::read(run)).collect::<Result<Vec<_>, _>>()?;
        let mut outcome = merge::of_runs(&arguments.name, runs)?;
        for file in &arguments.held_out {
            outcome.judge_file(file, share)?;
        }
        merge::write(&outcome, &out)?;
        Ok(outcome)
    })?;
    say(&outcome, &out, voice)
}

/// Carries out an experiment whose structure is `simo-merge`.
pub fn carry_out(experiment: &Experiment, base: &Path, out: &Path, resume: bool, voice: Voice) -> Result<(), Failure> {
    let bar = Bar::new(voice.quiet || voice.json);
    let outcome = directory::with(out, || {
        let outcome = merge::carry_out(experiment, base, out, resume, &bar);
        bar.finish();
        let outcome = outcome?;
        merge::write(&outcome, out)?;
        Ok(outcome)
    })?;
    say(&outcome, out, voice)
}

fn say(outcome: &Outcome, out: &Path, voice: Voice) -> Result<(), Failure> {
    if voice.json {
        let path = out.join("result.json");
        let text = std::fs::read_to_string(&path).map_err(|error| Failure::file(&path, &error))?;
        return voice::print(&text);
    }
    if voice.quiet {
        return Ok(());
    }
    let mut text = String::new();
    // Writing to a string does not fail.
    for sentence in merge::verdict(outcome) {
        let _ = writeln!(text, "{sentence}");
    }
    for run in &outcome.runs {
        let own = run.free_run.map_or("diverges".into(), |error| format!("{:.3} %", 100.0 * error));
        let _ = writeln!(text, "  {:<20} {:<10} own free run {own}", run.name, run.model.inputs.join(", "));
    }
    let _ = writeln!(text, "report: {}", out.join("report.html").display());
    voice::print(&text)?;
    outcome.warnings.iter().for_each(|warning| voice::remark(&format!("warning: {warning}")));
    Ok(())
}
