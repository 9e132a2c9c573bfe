use std::path::{Path, PathBuf};

use plid::gap::effects::Library;
use plid_trial::reliability::Reliability;
use plid_trial::scores::Scores;
use plid_trial::{Extent, score};

use super::progress::Bar;
use super::{Answered, Failure, Voice, voice};

/// Score the answers to a trial.
///
/// First records the hash of all answers in S, then checks the sealed files against the hashes in T, and only then
/// opens them. Writes report.html and scores.json. Answers that change afterwards are rejected.
#[derive(clap::Args)]
#[command(
    after_help = concat!(
        "Examples:\n",
        "  plid gap trial score T --sealed S\n",
        "  plid gap trial score T --sealed S --answered   # a diagnosis that was stopped half-way\n",
        "then open S/report.html",
    )
)]
pub struct Arguments {
    #[command(flatten)]
    answered: Answered,
    /// Score only the cases answered so far. Cases are in random order, so these are a fair sample; later answers are
    /// rejected.
    #[arg(long = "answered")]
    partial: bool,
    /// Folder for report.html, its figures power.svg and reliability.svg, and scores.json [default: S].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Runs the command.
pub fn execute(arguments: &Arguments, library: &Library, voice: Voice) -> Result<(), Failure> {
    let out = arguments.out.as_ref().unwrap_or(&arguments.answered.sealed);
    let extent = if arguments.partial { Extent::Answered } else { Extent::Whole };
    into(&arguments.answered.trial, &arguments.answered.sealed, extent, library, out, voice)
}

/// Scores into a directory and prints a summary.
pub fn into(
    trial: &Path,
    sealed: &Path,
    extent: Extent,
    library: &Library,
    out: &Path,
    voice: Voice,
) -> Result<(), Failure> {
    let bar = Bar::new(voice.quiet || voice.json);
    let scores = score(trial, sealed, extent, library, out, &bar);
    bar.finish();
    let scores = scores?;
    if voice.json {
        let text = serde_json::json!({
            "targets": scores.targets, "failures": scores.failures(), "report": out.join("report.html")
        });
        return voice::print(&format!("{text:#}\n"));
    }
    if voice.quiet {
        return Ok(());
    }
    voice::print(&format!("{}report: {}\n", summary(&scores), out.join("report.html").display()))
}

fn summary(scores: &Scores) -> String {
    let mut text = format!("{}, seed {}\n", scores.extent(), scores.seed);
    text.extend(scores.failures().map(|failures| failures + "\n"));
    for target in &scores.targets {
        let found = target.found.map_or("-".to_owned(), |found| format!("{found:.3}"));
        let sign = if target.at_least { ">=" } else { "<=" };
        let reached = match target.reached {
            Some(true) => "reached",
            Some(false) => "not reached",
            None => "no case asks",
        };
        text +=
            &format!("  {:<86} {found:>6} {sign} {:<5} of {:>4}  {reached}\n", target.what, target.bound, target.of);
    }
    text + &reliability(scores)
}

/// Returns a line for each kind of statement: how many were true, the expected calibration error and the Brier score.
fn reliability(scores: &Scores) -> String {
    let figure = |x: Option<f64>| x.map_or("-".to_owned(), |x| format!("{x:.3}"));
    let line = |one: &Reliability| {
        let (name, right, found) = (one.about.name(), &one.right, &one.calibration);
        let (error, brier) = (figure(found.expected_error), figure(found.brier));
        format!(
            "  {name:<11} {:>4} of {:>4} true   calibration error {error}   Brier score {brier}\n",
            right.hits, right.of
        )
    };
    let lines: String = scores.reliability.iter().map(line).collect();
    if lines.is_empty() { lines } else { format!("statements of the answers:\n{lines}") }
}
