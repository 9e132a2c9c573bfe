//! `plid gap trial`: is the diagnosis right on cases whose effect is withheld from it?

mod ablate;
mod calibrate;
mod diagnose;
mod draw;
mod merge;
mod run;
mod score;

use std::path::PathBuf;

use clap::Subcommand;
use plid::gap::effects::Library;
use plid_trial::{TrialConfig, TrialError};

use super::{Failure, Voice, directory, progress, voice};

/// Blind trials of the diagnosis, on cases whose effects are withheld from it: draw, diagnose, score.
///
/// `draw` writes the cases to one directory and their true effects, sealed, to another. `diagnose` reads only the
/// first. `score` records the hash of all answers before it opens the sealed directory.
#[derive(clap::Args)]
#[command(
    after_help = concat!(
        "Example:\n",
        "  plid gap trial run --quick --out out/trial\n",
        "then open out/trial/report.html; or step by step:\n",
        "  plid gap trial draw --quick --out T --sealed S\n",
        "  plid gap trial diagnose T --jobs 2\n",
        "  plid gap trial score T --sealed S\n",
        "to measure the contribution of each step of the diagnosis:\n",
        "  plid gap trial ablate T --sealed S --out out/ablation",
    )
)]
pub struct Arguments {
    #[command(subcommand)]
    step: Step,
}

#[derive(Subcommand)]
enum Step {
    Draw(draw::Arguments),
    Diagnose(diagnose::Arguments),
    Merge(merge::Arguments),
    Score(score::Arguments),
    Run(run::Arguments),
    Ablate(ablate::Arguments),
    Calibrate(calibrate::Arguments),
}

/// A trial with its answers, and the withheld files.
#[derive(clap::Args)]
struct Answered {
    /// The folder with the cases and the answers.
    #[arg(value_name = "T")]
    trial: PathBuf,
    /// The sealed folder written by `plid gap trial draw`.
    #[arg(long, value_name = "S")]
    sealed: PathBuf,
}

/// Which trial.
#[derive(clap::Args)]
struct Which {
    /// The trial's config: one of experiments/trials, or your own.
    #[arg(value_name = "TRIAL.toml", required_unless_present = "quick", conflicts_with = "quick")]
    config: Option<PathBuf>,
    /// The built-in trial of sixty cases, experiments/trials/quick.toml.
    #[arg(long)]
    quick: bool,
}

impl Which {
    fn read(&self) -> Result<TrialConfig, Failure> {
        let config = self.config.as_ref().map_or_else(TrialConfig::quick, |path| TrialConfig::read(path));
        config.map_err(|error| Failure::Input(error.into()))
    }
}

/// Runs the command.
pub fn execute(arguments: Arguments, library: &Library, voice: Voice) -> Result<(), Failure> {
    match arguments.step {
        Step::Draw(arguments) => draw::execute(&arguments, voice),
        Step::Diagnose(arguments) => diagnose::execute(&arguments, library, voice),
        Step::Merge(arguments) => merge::execute(&arguments, voice),
        Step::Score(arguments) => score::execute(&arguments, library, voice),
        Step::Run(arguments) => run::execute(&arguments, library, voice),
        Step::Ablate(arguments) => ablate::execute(&arguments, library, voice),
        Step::Calibrate(arguments) => calibrate::execute(&arguments, voice),
    }
}

impl From<TrialError> for Failure {
    fn from(error: TrialError) -> Self {
        match error {
            TrialError::File { path, source } => Self::file(&path, &source),
            TrialError::Config(error) => Self::Input(error.into()),
            TrialError::Data(error) => error.into(),
            TrialError::Model(error) => error.into(),
            TrialError::Draw { .. } | TrialError::NotFinite { .. } | TrialError::Interrupted { .. } => {
                Self::Work(error.into())
            }
            _ => Self::Input(error.into()),
        }
    }
}
