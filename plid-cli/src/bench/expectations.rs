//! `plid bench expectations`: which conditional expectation to use, and whether the choice matters.

use plid_bench::expectations::{self, Config, FULL, QUICK};
use plid_work::SHARDS;

use super::Common;
use crate::part::Part;
use crate::progress::Bar;
use crate::{Failure, Voice, directory, voice};

/// Compare the conditional expectations with each other, with exact Bayesian estimation and with batch estimates.
///
/// Reports the NEES (is the stated accuracy true?), the RMS error and the free-run error for signal-to-noise ratios
/// between 0.3 and 300. The plants are a scalar plant, plants of 4 to 12 states, and the truss, identified with fewer
/// states than its true order. Sigma is the true one, or 100 times too small or too large; for the truss it has six
/// values from 1e-5 to 1 times R. The full study takes up to an hour on two cores, --quick up to five minutes. Ctrl-C
/// keeps finished cells in DIR/cells.jsonl, from which --resume continues.
#[derive(clap::Args)]
#[command(
    after_help = concat!(
        "Example:\n",
        "  plid bench expectations --quick --out out/expectations\n",
        "then open out/expectations/report.html.",
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
    let out = common.output.directory_of("bench-expectations", part, SHARDS)?;
    let resume = common.output.keeps(part);
    let bar = Bar::new(voice.quiet || voice.json);
    if let Some(shard) = part.shard {
        let done = directory::with(&out, || Ok(expectations::run_shard(&config, &out, shard, resume, &bar)?));
        bar.finish();
        return done.and_then(|()| Part::tell_shard(shard, voice));
    }
    let study = directory::with(&out, || {
        if part.merge {
            expectations::merge(&config, &out)?;
        }
        let study = expectations::run(&config, &out, resume, &bar);
        bar.finish();
        Ok(study?)
    })?;
    if voice.json {
        voice::print(&study.json()?)
    } else if voice.quiet {
        Ok(())
    } else {
        let lines: String = study.verdict.iter().map(|sentence| format!("{sentence}\n")).collect();
        voice::print(&format!("{lines}report: {}\n", out.join("report.html").display()))
    }
}
