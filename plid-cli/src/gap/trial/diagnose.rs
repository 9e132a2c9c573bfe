use std::path::PathBuf;

use plid::gap::Step;
use plid::gap::effects::Library;
use plid_trial::{Done, Options, Shard, diagnose, diagnose_alone, diagnose_without};
use serde_json::json;

use super::progress::Bar;
use super::{Failure, Voice, voice};

/// Diagnose the cases of a trial without access to the sealed files.
///
/// Writes T/answers, one case at a time; existing answers are kept. With --shard, writes T/shards/i-of-N for
/// `plid gap trial merge`. With --off, writes T/ablation for `plid gap trial ablate`.
#[derive(clap::Args)]
#[command(
    after_help = concat!(
        "Examples:\n",
        "  plid gap trial diagnose T --jobs 2\n",
        "  plid gap trial diagnose T --shard 3/16\n",
        "  plid gap trial merge T",
    )
)]
pub struct Arguments {
    /// The cases, as written by `plid gap trial draw`.
    #[arg(value_name = "T")]
    trial: PathBuf,
    /// Every N-th case only, starting with the i-th.
    #[arg(long, value_name = "i/N")]
    shard: Option<Shard>,
    /// Number of cases diagnosed at a time [default: number of cores].
    #[arg(long, value_name = "J")]
    jobs: Option<usize>,
    /// Leave out the simpler methods with which the diagnosis is compared.
    #[arg(long, conflicts_with = "off")]
    no_baselines: bool,
    /// Diagnose with nothing switched off, and again with each of these steps switched off (separated by commas).
    #[arg(long, value_name = "STEP", value_delimiter = ',', conflicts_with = "shard")]
    off: Vec<Step>,
}

/// Runs the command.
pub fn execute(arguments: &Arguments, library: &Library, voice: Voice) -> Result<(), Failure> {
    let jobs = jobs(arguments.jobs)?;
    let bar = Bar::new(voice.quiet || voice.json);
    let (trial, options) = (&arguments.trial, Options { shard: arguments.shard, jobs });
    let done = match (arguments.off.is_empty(), arguments.no_baselines) {
        (true, false) => diagnose(trial, options, library, &bar).map(|done| vec![done]),
        (true, true) => diagnose_alone(trial, options, library, &bar).map(|done| vec![done]),
        (false, _) => diagnose_without(trial, &arguments.off, jobs, library, &bar),
    };
    bar.finish();
    done?.iter().try_for_each(|done| tell(done, voice))
}

/// A summary with one line for each set of answers.
fn tell(done: &Done, voice: Voice) -> Result<(), Failure> {
    if voice.json {
        let failed: Vec<_> = done.failed.iter().map(|(case, why)| json!({ "case": case, "reason": why })).collect();
        let text = json!({
            "cases": done.cases, "before": done.before, "failed": failed, "answers": done.answers
        });
        return voice::print(&format!("{text}\n"));
    }
    if voice.quiet {
        return Ok(());
    }
    let failed: String = done.failed.iter().map(|(case, why)| format!("no answer to {case}: {why}\n")).collect();
    voice::print(&format!(
        "{} cases, {} of them answered before: {}\n{failed}",
        done.cases,
        done.before,
        done.answers.display()
    ))
}

/// Returns the number of cases diagnosed at a time.
pub fn jobs(given: Option<usize>) -> Result<usize, Failure> {
    match given {
        Some(0) => Err(Failure::input("--jobs 0: give 1 or more")),
        Some(jobs) => Ok(jobs),
        None => Ok(std::thread::available_parallelism().map_or(1, usize::from)),
    }
}
