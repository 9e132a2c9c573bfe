//! `plid run`: carries out an experiment, from its file to its report.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use plid::lab::experiment::{self, Experiment, Refinement, StructureKind};
use plid::lab::run::{self, Outcome, RunError};

use super::directory::Output;
use super::progress::Bar;
use super::{Failure, Voice, directory, voice};

/// Carry out an experiment: obtain the data, identify, validate on held-out data and report.
///
/// Writes DIR/report.html (and its first figure as frf.svg), result.json, model.json, innovations.csv and manifest.json
/// (every default, and the hashes of the input files). The same experiment gives the same bytes. Ctrl-C leaves a
/// checkpoint, from which --resume continues to the same result.
#[derive(clap::Args)]
#[command(
    after_help = concat!(
        "Example:\n",
        "  plid run experiments/truss-mimo-30.toml --out out/truss\n",
        "\n",
        "The shortest experiment file for data of your own:\n",
        "  [data]\n",
        "  files = [\"record.csv\"]\n",
        "  inputs = [\"force\"]\n",
        "  outputs = [\"left\", \"right\"]\n",
        "  [structure]\n",
        "  states = 8",
    )
)]
pub struct Arguments {
    /// The experiment, a TOML file; the paths in it are relative to it.
    experiment: PathBuf,
    /// Second model, refined for simulation: output-error or off [default: as in the experiment].
    #[arg(long, value_name = "HOW", value_parser = super::identify::parse::<Refinement>)]
    refine: Option<Refinement>,
    #[command(flatten)]
    output: Output,
}

/// Runs the command.
pub fn execute(arguments: Arguments, voice: Voice) -> Result<(), Failure> {
    let path = &arguments.experiment;
    let mut experiment = experiment::read(path).map_err(RunError::from)?;
    if let Some(refine) = arguments.refine {
        experiment.identification.refine = refine;
    }
    let base = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let out = arguments.output.directory(&experiment.name)?;
    let Output { resume, force, .. } = arguments.output;
    if resume && !force {
        run::require_own(&experiment, base, &out)?;
    }
    if experiment.structure.kind == StructureKind::SimoMerge {
        return super::merge::carry_out(&experiment, base, &out, resume, voice);
    }
    carry_out(&experiment, base, &out, resume, voice)
}

/// Carries out an experiment and prints a summary.
pub fn carry_out(experiment: &Experiment, base: &Path, out: &Path, resume: bool, voice: Voice) -> Result<(), Failure> {
    let bar = Bar::new(voice.quiet || voice.json);
    let outcome = directory::with(out, || {
        let outcome = run::carry_out(experiment, base, Some(out), resume, &bar);
        bar.finish();
        let outcome = outcome?;
        run::write(&outcome, out)?;
        Ok(outcome)
    })?;
    if voice.json {
        let path = out.join("result.json");
        let text = std::fs::read_to_string(&path).map_err(|error| Failure::file(&path, &error))?;
        voice::print(&text)
    } else if voice.quiet {
        Ok(())
    } else {
        voice::print(&summary(&outcome, out))?;
        outcome.warnings.iter().for_each(|warning| voice::remark(&format!("warning: {warning}")));
        outcome.advice.iter().for_each(|advice| voice::remark(&format!("advice: {advice}")));
        Ok(())
    }
}

fn summary(outcome: &Outcome, out: &Path) -> String {
    let validation = &outcome.validation;
    let percent = |value: Option<f64>| match value {
        Some(value) if value.is_finite() => format!("{:.3} %", 100.0 * value),
        Some(value) if value.is_nan() => "constant".into(),
        Some(_) => "diverges".into(),
        None => "-".into(),
    };
    let mut text = String::new();
    // Writing to a string does not fail.
    let mut row = |name: &str, one_step: String, free_run: String| {
        let _ = writeln!(text, "  {name:<20} {one_step:>10} {free_run:>10}");
    };
    row("output", "one-step".into(), "free run".into());
    let one_step = validation.one_step_errors.as_ref();
    let free_run = &validation.free_run_errors;
    for (i, name) in outcome.model.outputs.iter().enumerate() {
        row(name, percent(one_step.map(|e| e.relative[i])), percent(Some(free_run.relative[i])));
    }
    row("all", percent(one_step.map(|e| e.overall_relative)), percent(Some(free_run.overall_relative)));
    let simulation = &outcome.simulation;
    let alternatives =
        [("refined", simulation.refined.as_ref().map(|r| &r.0)), ("subspace", simulation.subspace.as_ref())];
    for (name, alternative) in alternatives {
        if let Some(model) = alternative {
            let one_step = model.one_step_errors.as_ref().map(|e| e.overall_relative);
            row(name, percent(one_step), percent(Some(model.free_run_errors.overall_relative)));
        }
    }
    if let Some(streamed) = &outcome.streamed {
        let one_step = streamed.one_step.as_ref().map(|e| e.overall_relative);
        row("whole tail", percent(one_step), percent(Some(streamed.free_run.overall_relative)));
    }
    if let Some(truth) = &validation.truth_errors {
        row("true plant", String::new(), percent(Some(truth.overall_relative)));
    }
    format!(
        "{} states, observability indices {:?}\nheld-out errors, RMS over RMS of the output:\n{text}report: {}\n",
        outcome.model.n(),
        outcome.form.indices(),
        out.join("report.html").display()
    )
}
