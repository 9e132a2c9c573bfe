//! `plid bench`: studies on the own machine, one a file.

mod expectations;
mod speed;
mod stability;

use std::path::{Path, PathBuf};

use clap::Subcommand;
use plid_bench::study::{self, StudyError};
use serde::de::DeserializeOwned;

use super::{Failure, Voice, directory};

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

/// What every study takes.
#[derive(clap::Args)]
pub struct Common {
    /// The study's config, a TOML file like those in experiments/bench [default: the full study].
    #[arg(conflicts_with = "quick")]
    config: Option<PathBuf>,
    /// A smaller study that takes minutes.
    #[arg(long)]
    quick: bool,
    /// Output directory [default: out/bench-STUDY].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Continue an interrupted study in the output directory without repeating finished measurements.
    #[arg(long)]
    resume: bool,
    /// Write into a directory that is not empty.
    #[arg(long)]
    force: bool,
}

impl Common {
    /// The output directory, checked.
    fn directory(&self, study: &str) -> Result<PathBuf, Failure> {
        let out = self.out.clone().unwrap_or_else(|| Path::new("out").join(format!("bench-{study}")));
        directory::check(&out, self.force || self.resume)?;
        Ok(out)
    }

    /// The config: the file that was named, or the text built in for the full or the quick study.
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
