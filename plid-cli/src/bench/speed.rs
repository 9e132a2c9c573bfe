//! `plid bench speed`: the time of a step, compared with the limits of the machine.

use std::path::PathBuf;

use plid_bench::speed::compare::{self, Comparison};
use plid_bench::speed::{self, Config, FULL, Outcome, QUICK, Target, peers};
use serde::Serialize;

use super::Common;
use crate::progress::Bar;
use crate::{Failure, Voice, directory, voice};

/// Time a step by size, form, expectation, library and scalar, relative to a pass over P and to the machine's peak.
///
/// Writes DIR/report.html, speed.csv, speed.json (for --compare), machine.json and config.toml. The full study takes
/// about ten minutes on two cores; nothing else should run at the same time. Ctrl-C keeps finished measurements in
/// DIR/cells.jsonl, from which --resume continues.
#[derive(clap::Args)]
#[command(
    after_help = concat!(
        "Examples:\n",
        "  plid bench speed --quick --out out/speed\n",
        "  plid bench speed experiments/bench/speed.toml --out out/speed\n",
        "  plid bench speed --quick --out out/after --compare out/before/speed.json",
    )
)]
pub struct Arguments {
    #[command(flatten)]
    common: Common,
    /// Earlier speed.json: list cells that became slower or faster, in passes over P; exit with status 1 if one is
    /// slower.
    #[arg(long, value_name = "OLD.json")]
    compare: Option<PathBuf>,
    /// Smallest relative change to report.
    #[arg(long, value_name = "SHARE", default_value_t = compare::TOLERANCE, requires = "compare")]
    tolerance: f64,
    /// Times of other software, as written by plid-bench/peers, for the report.
    #[arg(long, value_name = "FILE")]
    peers: Option<PathBuf>,
}

/// Runs the command.
pub fn execute(arguments: &Arguments, voice: Voice) -> Result<(), Failure> {
    let config: Config = arguments.common.config(FULL, QUICK, Config::problems)?;
    let old = arguments.compare.as_deref().map(compare::read).transpose()?;
    let peers = arguments.peers.as_deref().map(peers::read).transpose()?;
    if !(arguments.tolerance >= 0.0 && arguments.tolerance.is_finite()) {
        return Err(Failure::input(format!("--tolerance: {} is not 0 or above", arguments.tolerance)));
    }
    let out = arguments.common.output.directory("bench-speed")?;
    let bar = Bar::new(voice.quiet || voice.json);
    let outcome = directory::with(&out, || {
        let outcome = speed::carry_out(&config, &out, arguments.common.output.resume, &bar);
        bar.finish();
        let outcome = outcome?;
        speed::write_all(&outcome, peers.as_ref(), &out)?;
        Ok(outcome)
    })?;
    let comparison = old.map(|old| compare::compare(&old, &outcome, arguments.tolerance));
    if voice.json {
        voice::json(&Said { targets: speed::targets(&outcome, None), comparison: comparison.as_ref() })?;
    } else if !voice.quiet {
        let compared = comparison.as_ref().map(Comparison::text).unwrap_or_default();
        voice::print(&format!("{}{compared}report: {}\n", summary(&outcome), out.join("report.html").display()))?;
    }
    match comparison {
        Some(comparison) if !comparison.slower.is_empty() => Err(Failure::work(format!(
            "{} of {} cells are slower than in the former run",
            comparison.slower.len(),
            comparison.compared
        ))),
        _ => Ok(()),
    }
}

/// Summarises the steps at the largest size in a few lines.
fn summary(outcome: &Outcome) -> String {
    let targets = speed::targets(outcome, None);
    let mut text = format!("{} cells timed\n", outcome.timings.len());
    for target in targets {
        let met = match target.met {
            Some(true) => "reached",
            Some(false) => "not reached",
            None => "",
        };
        text += &format!("  {:<60} {:>28}  {:>16}  {met}\n", target.what, target.found, target.target);
    }
    text
}

/// What is printed with `--json`.
#[derive(Serialize)]
struct Said<'a> {
    targets: Vec<Target>,
    #[serde(skip_serializing_if = "Option::is_none")]
    comparison: Option<&'a Comparison>,
}
