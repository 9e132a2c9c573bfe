//! `plid bench stability`: how long P stays a covariance, by form, scalar and size.

use plid_bench::stability::{self, Config, FULL, Outcome, QUICK};
use plid_bench::study::StudyError;
use plid_work::SHARDS;

use super::Common;
use crate::part::Part;
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
        "  plid bench stability experiments/bench/stability.toml --out out/stability\n",
        "  plid bench stability --out out/stability --shard 3/8   # run every shard 1/8 … 8/8, on any machine\n",
        "  plid bench stability --out out/stability --merge",
    )
)]
pub struct Arguments {
    #[command(flatten)]
    common: Common,
    #[command(flatten)]
    part: Part,
}

/// Runs the command.
pub fn execute(arguments: &Arguments, voice: Voice) -> Result<(), Failure> {
    let config: Config = arguments.common.config(FULL, QUICK, Config::problems)?;
    let Arguments { common, part } = arguments;
    let out = common.output.directory_of("bench-stability", part, SHARDS)?;
    let resume = common.output.keeps(part);
    let bar = Bar::new(voice.quiet || voice.json);
    if let Some(shard) = part.shard {
        let done = directory::with(&out, || Ok(stability::run_shard(&config, &out, shard, resume, &bar)?));
        bar.finish();
        return done.and_then(|()| Part::tell_shard(shard, voice));
    }
    let outcome = directory::with(&out, || {
        if part.merge {
            stability::merge(&config, &out)?;
        }
        let outcome = stability::carry_out(&config, &out, resume, &bar);
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

/// Returns the verdicts.
fn summary(outcome: &Outcome) -> String {
    let mut text = format!("{} cells\n", outcome.cells.len());
    for claim in &outcome.claims {
        text += &format!("  {}\n    {}\n", claim.claim, claim.verdict);
    }
    text
}
