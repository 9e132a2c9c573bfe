use std::path::PathBuf;
use std::process::{Command, Stdio};

use plid::gap::Step;
use plid::gap::effects::Library;
use plid_trial::ablation::Ablation;
use plid_trial::score_without;

use super::progress::Bar;
use super::{Answered, Failure, Voice, diagnose, voice};

/// Ablation: diagnose a trial again with one step switched off at a time, and score the results.
///
/// The trial must have answers to all cases. It is diagnosed with nothing switched off (which must reproduce its
/// answers) and with each step switched off, in a separate process that knows only T. These answers are kept in
/// T/ablation, so that the same command continues after an interruption. Their hashes are recorded in S, and all are
/// scored in the same way. Writes DIR/report.html and DIR/ablation.json: for each step, the changes in names, sets,
/// false alarms and time, the cases that are better or worse without it, and a sign test.
#[derive(clap::Args)]
#[command(after_help = help())]
pub struct Arguments {
    #[command(flatten)]
    answered: Answered,
    /// Folder for report.html and ablation.json.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Only these steps, separated by commas [default: all].
    #[arg(long, value_name = "STEP", value_delimiter = ',')]
    steps: Vec<Step>,
    /// Number of cases diagnosed at a time [default: number of cores].
    #[arg(long, value_name = "J")]
    jobs: Option<usize>,
}

fn help() -> String {
    let steps: String = Step::ALL.iter().map(|step| format!("  {:<15} {}\n", step.name(), step.when_off())).collect();
    format!(
        "Steps, and what replaces each when it is off:\n{steps}\n\
         Examples:\n  plid gap trial run --quick --out out/trial\n  \
         plid gap trial ablate out/trial/trial --sealed out/trial/sealed --out out/ablation\n  \
         plid gap trial ablate T --sealed S --out out/ablation --steps polishing,questioning"
    )
}

/// Runs the command.
pub fn execute(arguments: &Arguments, library: &Library, voice: Voice) -> Result<(), Failure> {
    let jobs = diagnose::jobs(arguments.jobs)?;
    let steps = if arguments.steps.is_empty() { Step::ALL.to_vec() } else { arguments.steps.clone() };
    let names: Vec<&str> = steps.iter().map(|step| step.name()).collect();
    let program = std::env::current_exe().map_err(Failure::work)?;
    let mut command = Command::new(program);
    command.args(["gap", "trial", "diagnose"]).arg(&arguments.answered.trial);
    command.args(["--off", &names.join(","), "--jobs", &jobs.to_string()]);
    command.args(["--quiet"].iter().filter(|_| voice.quiet || voice.json));
    // Its output is not a result of this command.
    let status = command.stdout(Stdio::null()).status().map_err(Failure::work)?;
    if !status.success() {
        return Err(Failure::work(format!(
            "the diagnosis ended with {status}; run the same command again to continue"
        )));
    }
    let bar = Bar::new(voice.quiet || voice.json);
    let ablation =
        score_without(&arguments.answered.trial, &arguments.answered.sealed, &steps, library, &arguments.out, &bar);
    bar.finish();
    let ablation = ablation?;
    let report = arguments.out.join("report.html");
    if voice.json {
        let text = serde_json::json!({ "steps": ablation.steps, "report": report });
        return voice::print(&format!("{text:#}\n"));
    }
    if voice.quiet {
        return Ok(());
    }
    voice::print(&format!("{}report: {}\n", summary(&ablation), report.display()))
}

fn summary(ablation: &Ablation) -> String {
    let mut text = format!("{} cases, seed {}\n", ablation.cases, ablation.seed);
    for without in &ablation.steps {
        let changed = match without.changed.len() {
            0 => "no answer changed".to_owned(),
            count => format!("{count} of {} answers changed", ablation.cases),
        };
        // The first reading is whether a case is answered correctly.
        let right = without.changes.first().map_or_else(String::new, |change| {
            format!("{} better, {} worse, p = {:.2}", change.better.len(), change.worse.len(), change.p)
        });
        text += &format!("  without {:<15} {changed:<24} {right}\n", without.step.name());
    }
    text
}
