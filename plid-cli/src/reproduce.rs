//! `plid reproduce`: tests the paper claim by claim.

use std::path::PathBuf;

use plid_paper::{CLAIMS, Line, Options};
use plid_work::SHARDS;

use super::part::Part;
use super::progress::Bar;
use super::{Failure, Voice, directory, voice};

/// Run every figure and claim of Vallone and Hopkins (1995) on the simulated truss.
///
/// Writes DIR/report.html, which compares each statement of the paper with our figure and verdict, DIR/claims.json, and
/// for each claim DIR/ID with claim.json, its figures and its configs. Everything takes up to half an hour on two
/// cores, --quick up to three minutes. Finished claims are kept: the same command continues after an interruption, and
/// repeats only claims whose config has changed.
#[derive(clap::Args)]
#[command(
    after_help = concat!(
        "Examples:\n",
        "  plid reproduce --quick --out out/paper\n",
        "  plid reproduce --only fig6 --only drift\n",
        "  plid reproduce --out out/paper --shard 3/8   # run every shard 1/8 … 8/8, on any machine\n",
        "  plid reproduce --out out/paper --merge\n",
        "then open out/paper/report.html. The configs are in experiments/paper; those that identify a model also run ",
        "by themselves, as in `plid run experiments/paper/fig8.toml`.",
    )
)]
pub struct Arguments {
    /// Output directory.
    #[arg(long, value_name = "DIR", default_value = "out/paper")]
    out: PathBuf,
    /// This claim only. May be repeated.
    #[arg(long, value_name = "ID")]
    only: Vec<String>,
    /// Fewer seeds and shorter records; takes minutes.
    #[arg(long)]
    quick: bool,
    /// Directory with ID.toml and ID.vary.toml to be used instead of the built-in ones.
    #[arg(long, value_name = "DIR")]
    configs: Option<PathBuf>,
    /// Discard earlier results, and write into the directory even if it is not empty.
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    part: Part,
}

/// Runs the command.
pub fn execute(arguments: Arguments, voice: Voice) -> Result<(), Failure> {
    let Arguments { out, only, quick, configs, force, part } = arguments;
    let known: Vec<&str> = CLAIMS.iter().map(|claim| claim.id).collect();
    if let Some(id) = only.iter().find(|id| !known.contains(&id.as_str())) {
        return Err(Failure::input(format!("--only: there is no claim `{id}`; there are {}", known.join(", "))));
    }
    let is_ours = ["claims.json", "cells.jsonl", SHARDS].iter().any(|name| out.join(name).exists());
    directory::check(&out, force || is_ours)?;
    let Part { shard, merge } = part;
    let options = Options { only, quick, configs, anew: force, shard, merge };
    let bar = Bar::new(voice.quiet || voice.json);
    let lines = directory::with(&out, || {
        let lines = plid_paper::reproduce(CLAIMS, &options, &out, &bar);
        bar.finish();
        Ok(lines?)
    })?;
    if let Some(shard) = shard {
        return Part::tell_shard(shard, voice);
    }
    if voice.json {
        let path = out.join("claims.json");
        voice::print(&std::fs::read_to_string(&path).map_err(|error| Failure::file(&path, &error))?)
    } else if voice.quiet {
        Ok(())
    } else {
        let text: String = lines.iter().filter_map(line).collect();
        voice::print(&format!("{text}report: {}\n", out.join("report.html").display()))
    }
}

fn line(line: &Line) -> Option<String> {
    let finding = line.finding.as_ref()?;
    Some(format!("{:<9} {:<18} {}\n", line.claim.id, finding.verdict().words(), finding.sentence))
}
