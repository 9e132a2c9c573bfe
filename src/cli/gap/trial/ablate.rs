use std::path::PathBuf;
use std::process::{Command, Stdio};

use plid::gap::Step;
use plid_trial::ablation::Ablation;
use plid_trial::score_without;

use super::progress::Bar;
use super::{Answered, Failure, Voice, diagnose, voice};

/// What is each step of the diagnosis worth? Diagnose a trial again with one step off at a time, and score.
///
/// The trial must have answers to all cases. It is diagnosed with nothing off (which must give the same answers) and with each step off, in a
/// process that is given T alone; these answers go to T/ablation, and what stands there is not given again, so that the same command goes on
/// after an interruption. Then all are scored by the same judge, their hashes fixed in S first. Writes DIR/report.html and DIR/ablation.json:
/// for each step what changes in names, sets, false alarms and time, the cases that are better or worse without it, and a sign test.
#[derive(clap::Args)]
#[command(after_help = help())]
pub struct Arguments {
    #[command(flatten)]
    answered: Answered,
    /// Where report.html and ablation.json go.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Only these steps, with commas between them; all if left out.
    #[arg(long, value_name = "STEP", value_delimiter = ',')]
    steps: Vec<Step>,
    /// Cases at a time; as many as there are cores if left out.
    #[arg(long, value_name = "J")]
    jobs: Option<usize>,
}

fn help() -> String {
    let steps: String = Step::ALL.iter().map(|step| format!("  {:<15} {}\n", step.name(), step.when_off())).collect();
    format!(
        "Steps, and what is done without them:\n{steps}\nExamples:\n  plid gap trial run --quick --out out/trial\n  plid gap trial ablate out/trial/trial --sealed out/trial/sealed --out out/ablation\n  plid gap trial ablate T --sealed S --out out/ablation --steps polishing,questioning"
    )
}

/// Runs the command.
pub fn execute(arguments: &Arguments, voice: Voice) -> Result<(), Failure> {
    let jobs = diagnose::jobs(arguments.jobs)?;
    let steps = if arguments.steps.is_empty() { Step::ALL.to_vec() } else { arguments.steps.clone() };
    let names: Vec<&str> = steps.iter().map(|step| step.name()).collect();
    let program = std::env::current_exe().map_err(Failure::work)?;
    let mut command = Command::new(program);
    command.args(["gap", "trial", "diagnose"]).arg(&arguments.answered.trial);
    command.args(["--off", &names.join(","), "--jobs", &jobs.to_string()]);
    command.args(["--quiet"].iter().filter(|_| voice.quiet || voice.json));
    // What it prints is no result of this command.
    let status = command.stdout(Stdio::null()).status().map_err(Failure::work)?;
    if !status.success() {
        return Err(Failure::work(format!(
            "the diagnosis ended with {status}; the same command goes on from what is done"
        )));
    }
    let bar = Bar::new(voice.quiet || voice.json);
    let ablation = score_without(&arguments.answered.trial, &arguments.answered.sealed, &steps, &arguments.out, &bar);
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
        // The first reading is whether a case is rightly answered.
        let right = without.changes.first().map_or_else(String::new, |change| {
            format!("{} better, {} worse, p = {:.2}", change.better.len(), change.worse.len(), change.p)
        });
        text += &format!("  without {:<15} {changed:<24} {right}\n", without.step.name());
    }
    text
}
