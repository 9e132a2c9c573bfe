//! `plid bench stability`: how long P stays a covariance, by form, scalar and size.

use plid_bench::stability::{self, Config, FULL, Outcome, QUICK};
use plid_bench::study::StudyError;

use super::Common;
use crate::progress::Bar;
use crate::{Failure, Voice, directory, voice};

/// Compare long runs of every form in single and double precision with the same recursion in double-double.
///
/// Writes DIR/report.html, stability.csv, stability.json, machine.json and config.toml. The full study takes up to
/// three hours on two cores. Cells run in parallel and give the same figures on any number of threads (set by
/// RAYON_NUM_THREADS). Ctrl-C keeps finished cells in DIR/cells.jsonl, from which --resume continues.
#[derive(clap::Args)]
#[command(
    after_help = concat!(
        "Examples:\n",
        "  plid bench stability --quick --out out/stability\n",
        "  plid bench stability experiments/bench/stability.toml --out out/stability",
    )
)]
pub struct Arguments {
    #[command(flatten)]
    common: Common,
}

/// Runs the command.
pub fn execute(arguments: &Arguments, voice: Voice) -> Result<(), Failure> {
    let config: Config = arguments.common.config(FULL, QUICK, Config::problems)?;
    let out = arguments.common.output.directory("bench-stability")?;
    let bar = Bar::new(voice.quiet || voice.json);
    let outcome = directory::with(&out, || {
        let outcome = stability::carry_out(&config, &out, arguments.common.output.resume, &bar);
        bar.finish();
        let outcome = outcome?;
        stability::write_all(&outcome, &out)?;
        Ok(outcome)
    })?;
    if voice.json {
        let content = outcome.json().map_err(StudyError::not_finite("stability.json"))?;
        voice::print(&format!("{content:#}\n"))
    } else if voice.quiet {
        Ok(())
    } else {
        voice::print(&format!("{}report: {}\n", summary(&outcome), out.join("report.html").display()))
    }
}

/// The verdicts.
fn summary(outcome: &Outcome) -> String {
    let mut text = format!("{} cells\n", outcome.cells.len());
    for claim in &outcome.claims {
        text += &format!("  {}\n    {}\n", claim.claim, claim.verdict);
    }
    text
}
