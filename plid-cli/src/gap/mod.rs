//! `plid gap`: where a simulation disagrees with reality, and why.

mod check_simulator;
mod diagnose;
mod in_loop;
mod predict;
mod serve_fmu;
mod trial;

use clap::Subcommand;
use plid::gap::GapError;
use plid::gap::effects::Library;

use super::{Failure, Voice, directory, progress, table, voice};

/// Find what a simulation lacks: where it disagrees with records, which effect causes the gap, and how much of it that
/// effect closes.
#[derive(clap::Args)]
#[command(
    after_help = concat!(
        "Example:\n",
        "  plid gap diagnose case.toml --out out/gap\n",
        "then open out/gap/report.html, and\n",
        "  plid gap predict --diagnosis out/gap/diagnosis.json --input u.csv --out y.csv",
    )
)]
pub struct Arguments {
    #[command(subcommand)]
    step: Step,
}

#[derive(Subcommand)]
enum Step {
    Diagnose(diagnose::Arguments),
    CheckSimulator(check_simulator::Arguments),
    Predict(predict::Arguments),
    ServeFmu(serve_fmu::Arguments),
    Trial(trial::Arguments),
}

/// Runs the command. The vocabulary of diagnoses, predictions and blind trials is `library`.
pub fn execute(arguments: Arguments, library: Library, voice: Voice) -> Result<(), Failure> {
    match arguments.step {
        Step::Diagnose(arguments) => diagnose::execute(arguments, library, voice),
        Step::CheckSimulator(arguments) => check_simulator::execute(&arguments, voice),
        Step::Predict(arguments) => predict::execute(arguments, &library, voice),
        Step::ServeFmu(arguments) => serve_fmu::execute(&arguments),
        Step::Trial(arguments) => trial::execute(arguments, &library, voice),
    }
}

impl From<GapError> for Failure {
    fn from(error: GapError) -> Self {
        match error {
            GapError::Io { file, source } => Self::file(&file, &source),
            GapError::Case(error) => Self::Input(error.into()),
            GapError::Data(error) => error.into(),
            GapError::Model(error) => error.into(),
            GapError::Simulator(_) | GapError::Failed(_) | GapError::NotFinite { .. } | GapError::Diverged { .. } => {
                Self::Work(error.into())
            }
            _ => Self::Input(error.into()),
        }
    }
}
