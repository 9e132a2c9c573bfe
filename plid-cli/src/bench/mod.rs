//! `plid bench`: studies on the user's machine, one file each.

mod expectations;
mod speed;
mod stability;

use std::path::PathBuf;

use clap::Subcommand;
use plid_bench::study::{self, StudyError};
use serde::de::DeserializeOwned;

use super::directory::Output;
use super::{Failure, Voice};

/// Study plid on this machine: speed, numerical stability and conditional expectations.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  plid bench speed --quick --out out/speed\nthen open out/speed/report.html.")]
pub struct Arguments {
    #[command(subcommand)]
    study: Study,
}

#[derive(Subcommand)]
enum Study {
    Expectations(expectations::Arguments),
    Speed(speed::Arguments),
    Stability(stability::Arguments),
}

/// The arguments of every study.
#[derive(clap::Args)]
pub struct Common {
    /// The study's config, a TOML file like those in experiments/bench [default: the full study].
    #[arg(conflicts_with = "quick")]
    config: Option<PathBuf>,
    /// A smaller study that takes minutes.
    #[arg(long)]
    quick: bool,
    #[command(flatten)]
    output: Output,
}

impl Common {
    /// Returns the config: the named file, or the built-in text of the full or the quick study.
    fn config<T: DeserializeOwned>(
        &self,
        full: &str,
        quick: &str,
        problems: impl FnOnce(&T) -> Vec<(&'static str, String)>,
    ) -> Result<T, Failure> {
        let config = match &self.config {
            Some(path) => study::read_checked(path, problems),
            None => study::from_toml_checked(if self.quick { quick } else { full }, "the built-in config", problems),
        };
        config.map_err(|error| StudyError::from(error).into())
    }
}

/// Runs the study that the arguments name.
pub fn execute(arguments: Arguments, voice: Voice) -> Result<(), Failure> {
    match arguments.study {
        Study::Expectations(arguments) => expectations::execute(&arguments, voice),
        Study::Speed(arguments) => speed::execute(&arguments, voice),
        Study::Stability(arguments) => stability::execute(&arguments, voice),
    }
}
