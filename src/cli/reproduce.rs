//! `plid reproduce`: the paper, claim by claim.

use std::path::PathBuf;

use plid_paper::{CLAIMS, Line, Options};

use super::progress::Bar;
use super::{Failure, Voice, directory, voice};

/// Run every figure and claim of Vallone and Hopkins (1995) on the simulated truss.
///
/// Writes DIR/report.html, which has the paper's statement, our figure and our verdict beside each other, DIR/claims.json, and for each claim DIR/ID with
/// claim.json, its pictures and its configs. All of it takes up to half an hour on two cores, --quick up to three minutes. Each claim is kept as
/// soon as it is there: the same command goes on after an interruption, and runs again only what has another config.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  plid reproduce --quick --out out/paper\n  plid reproduce --only fig6 --only drift\nthen open out/paper/report.html. The configs stand in experiments/paper; those that identify run on their own, as `plid run experiments/paper/fig8.toml`."
)]
pub struct Arguments {
    /// Where the results go.
    #[arg(long, value_name = "DIR", default_value = "out/paper")]
    out: PathBuf,
    /// This claim only; may be given several times.
    #[arg(long, value_name = "ID")]
    only: Vec<String>,
    /// Fewer seeds and shorter records: minutes.
    #[arg(long)]
    quick: bool,
    /// A directory with ID.toml and ID.vary.toml in place of those built in.
    #[arg(long, value_name = "DIR")]
    configs: Option<PathBuf>,
    /// Forget what the output directory has, and write into it whatever is there.
    #[arg(long)]
    force: bool,
}

/// Runs the command.
pub fn execute(arguments: Arguments, voice: Voice) -> Result<(), Failure> {
    let Arguments { out, only, quick, configs, force } = arguments;
    let known: Vec<&str> = CLAIMS.iter().map(|claim| claim.id).collect();
    if let Some(id) = only.iter().find(|id| !known.contains(&id.as_str())) {
        return Err(Failure::input(format!("--only: there is no claim `{id}`; there are {}", known.join(", "))));
    }
    directory::check(&out, force || out.join("claims.json").exists() || out.join("cells.jsonl").exists())?;
    let options = Options { only, quick, configs, anew: force };
    let bar = Bar::new(voice.quiet || voice.json);
    let lines = directory::with(&out, || {
        let lines = plid_paper::reproduce(CLAIMS, &options, &out, &bar);
        bar.finish();
        Ok(lines?)
    })?;
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
