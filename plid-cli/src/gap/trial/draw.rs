use std::path::{Path, PathBuf};

use plid_trial::{Drawn, TrialConfig, draw};

use super::progress::Bar;
use super::{Failure, Voice, Which, directory, voice};

/// Draw the cases of a trial and seal their true effects.
///
/// Writes the cases and a salted hash of each sealed file to T; labels, held-out records, salt and seed to S.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  plid gap trial draw experiments/trials/quick.toml --out T --sealed S")]
pub struct Arguments {
    #[command(flatten)]
    which: Which,
    /// Folder for the cases.
    #[arg(long, value_name = "T")]
    out: PathBuf,
    /// Folder for the sealed files, outside T.
    #[arg(long, value_name = "S")]
    sealed: PathBuf,
    /// Seed of the draw [default: from the system].
    #[arg(long)]
    seed: Option<u64>,
}

/// Runs the command.
pub fn execute(arguments: &Arguments, voice: Voice) -> Result<(), Failure> {
    let config = arguments.which.read()?;
    let drawn = into(&config, arguments.seed, &arguments.out, &arguments.sealed, voice)?;
    if voice.json {
        let text = serde_json::json!({ "cases": drawn.cases, "repeated_draws": drawn.repeated });
        return voice::print(&format!("{text}\n"));
    }
    if voice.quiet {
        return Ok(());
    }
    voice::print(&format!(
        "{} cases: {}\nsealed: {}\n",
        drawn.cases,
        arguments.out.display(),
        arguments.sealed.display()
    ))
}

/// Draws into two directories. Both must be new, and neither may lie within the other.
pub fn into(
    config: &TrialConfig,
    seed: Option<u64>,
    trial: &Path,
    sealed: &Path,
    voice: Voice,
) -> Result<Drawn, Failure> {
    for place in [trial, sealed] {
        if !directory::is_free(place)? {
            let place = place.display();
            return Err(Failure::input(format!("{place} exists and is not empty; a trial needs a new directory")));
        }
    }
    directory::with(trial, || {
        directory::with(sealed, || {
            if inside(sealed, trial)? || inside(trial, sealed)? {
                return Err(Failure::input("--sealed: the answers must be in a folder outside that of the cases"));
            }
            let bar = Bar::new(voice.quiet || voice.json);
            let drawn = draw(config, seed.unwrap_or_else(rand::random), trial, sealed, &bar);
            bar.finish();
            Ok(drawn?)
        })
    })
}

/// Whether one directory lies within another, whatever path names it.
fn inside(one: &Path, other: &Path) -> Result<bool, Failure> {
    let real = |path: &Path| path.canonicalize().map_err(|error| Failure::file(path, &error));
    Ok(real(one)?.starts_with(real(other)?))
}
