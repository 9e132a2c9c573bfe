//! `plid sweep`: an experiment over a grid of values of its keys.

use std::path::{Path, PathBuf};

use plid::lab::run::RunError;
use plid::lab::sweep::{self, POINTS, Row, Sweep};

use super::directory::Output;
use super::part::Part;
use super::progress::Bar;
use super::{Failure, Voice, directory, voice};

/// Carry out an experiment for every combination of values of its keys.
///
/// FILE.toml names an experiment and, in [vary], lists of values for any of its keys. Each point of the grid is one run
/// in DIR/points/NUMBER, with the files of `plid run`. Writes DIR/table.csv with the varied keys and the figures of
/// each run, DIR/report.html, and DIR/sweep.json, the grid. A run that fails is a row with its error. The same sweep
/// gives the same bytes, with or without shards. Ctrl-C keeps finished points and leaves checkpoints of the others;
/// --resume continues, and tries points that failed again.
#[derive(clap::Args)]
#[command(
    after_help = concat!(
        "Example of a FILE.toml; paths in the experiment are relative to the experiment:\n",
        "  experiment = \"truss-mimo-30.toml\"\n",
        "  [vary]\n",
        "  structure.states = [24, 30, 36]\n",
        "  noise.from = [\"tuned\", \"paper-literal\"]\n",
        "\n",
        "Examples:\n",
        "  plid sweep experiments/orders.toml --out out/orders\n",
        "  plid sweep experiments/orders.toml --out out/orders --shard 3/8\n",
        "  plid sweep experiments/orders.toml --out out/orders --merge\n",
        "then open out/orders/report.html.",
    )
)]
pub struct Arguments {
    /// The sweep, a TOML file; the path of the experiment in it is relative to it.
    #[arg(value_name = "FILE.toml")]
    file: PathBuf,
    #[command(flatten)]
    output: Output,
    #[command(flatten)]
    part: Part,
}

/// Runs the command.
pub fn execute(arguments: &Arguments, voice: Voice) -> Result<(), Failure> {
    let Arguments { file, output, part } = arguments;
    let sweep = Sweep::read(file).map_err(RunError::from)?;
    let out = output.directory_of(&sweep.name, part, POINTS)?;
    let bar = Bar::new(voice.quiet || voice.json);
    let rows = directory::with(&out, || {
        let rows = match part.merge {
            true => sweep::read(&sweep, &out),
            false => sweep::carry_out(&sweep, &out, part.shard, output.keeps(part), &bar),
        };
        bar.finish();
        let rows = rows?;
        if part.shard.is_none() {
            sweep::write(&sweep, &rows, &out)?;
        }
        Ok(rows)
    })?;
    let failed: Vec<&Row> = rows.iter().filter(|row| row.error.is_some()).collect();
    let report = part.shard.is_none().then(|| out.join("report.html"));
    if voice.json {
        let text = serde_json::json!({
            "points": rows.len(),
            "failed": failed.iter().map(|row| &row.number).collect::<Vec<_>>(),
            "folder": out,
        });
        voice::print(&format!("{text:#}\n"))
    } else if voice.quiet {
        Ok(())
    } else {
        voice::print(&summary(rows.len(), &failed, report.as_deref()))
    }
}

/// Returns the number of points, and the errors of those without a result.
fn summary(points: usize, failed: &[&Row], report: Option<&Path>) -> String {
    let mut text = format!("{points} points, {} of them failed\n", failed.len());
    for row in failed {
        text += &format!("  {}: {}\n", row.number, row.error.as_deref().unwrap_or_default());
    }
    text + &report.map_or_else(String::new, |report| format!("report: {}\n", report.display()))
}
