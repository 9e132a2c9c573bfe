//! The command line: arguments, exit status, and how an error is shown.
//!
//! Exit status: 0 done, 1 the work failed, 2 the arguments or a file are wrong.

mod identify;
mod progress;
mod run;
mod simulate;
mod table;
mod validate;

use std::io::IsTerminal;
use std::path::Path;
use std::process::ExitCode;

use clap::{Parser, Subcommand};
use miette::Report;
use plid::lab::model::ModelError;
use plid::lab::run::RunError;

/// Pseudo-linear identification: states and parameters of a linear plant, recursively, from measured inputs and outputs.
#[derive(Parser)]
#[command(
    name = "plid",
    version,
    after_help = "Start here:\n  plid run experiments/truss-mimo-30.toml --out out/truss\nthen open out/truss/report.html. `plid COMMAND --help` explains a command with an example."
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    /// No progress and no remarks; errors are still shown.
    #[arg(long, global = true)]
    quiet: bool,
    /// Print results as JSON on standard output, for another program to read.
    #[arg(long, global = true)]
    json: bool,
}

#[derive(Subcommand)]
enum Command {
    Run(run::Arguments),
    Identify(identify::Arguments),
    Simulate(simulate::Arguments),
    Validate(validate::Arguments),
}

/// How much is said, and in which form.
#[derive(Clone, Copy)]
struct Voice {
    quiet: bool,
    json: bool,
}

/// A failure with the exit status that it has.
enum Failure {
    /// The arguments or a file are wrong: 2.
    Input(Report),
    /// The work failed: 1.
    Work(Report),
}

impl Failure {
    fn input(message: impl std::fmt::Display) -> Self {
        Self::Input(Report::msg(message.to_string()))
    }

    fn work(message: impl std::fmt::Display) -> Self {
        Self::Work(Report::msg(message.to_string()))
    }
}

impl From<RunError> for Failure {
    fn from(error: RunError) -> Self {
        if error.is_input() { Self::Input(error.into()) } else { Self::Work(error.into()) }
    }
}

impl From<ModelError> for Failure {
    fn from(error: ModelError) -> Self {
        match error {
            ModelError::Diverged { .. } | ModelError::Riccati { .. } | ModelError::Eigenvalues => {
                Self::Work(error.into())
            }
            _ => Self::Input(error.into()),
        }
    }
}

impl From<plid::lab::data::DataError> for Failure {
    fn from(error: plid::lab::data::DataError) -> Self {
        Self::Input(error.into())
    }
}

/// Runs the command that the arguments name.
pub fn main() -> ExitCode {
    // clap prints help with status 0 and wrong arguments with status 2 by itself.
    let Cli { command, quiet, json } = Cli::parse();
    let voice = Voice { quiet, json };
    let done = match command {
        Command::Run(arguments) => run::execute(arguments, voice),
        Command::Identify(arguments) => identify::execute(arguments, voice),
        Command::Simulate(arguments) => simulate::execute(arguments, voice),
        Command::Validate(arguments) => validate::execute(arguments, voice),
    };
    let (report, status) = match done {
        Ok(()) => return ExitCode::SUCCESS,
        Err(Failure::Work(report)) => (report, 1),
        Err(Failure::Input(report)) => (report, 2),
    };
    // A terminal gets the text with the place marked; a log gets a line.
    if std::io::stderr().is_terminal() {
        eprintln!("{report:?}");
    } else {
        let help = report.help().map(|help| format!(" ({help})")).unwrap_or_default();
        eprintln!("plid: {report}{help}");
    }
    ExitCode::from(status)
}

/// An output directory must be new or empty, unless the user says otherwise.
fn check_directory(directory: &Path, allowed: bool) -> Result<(), Failure> {
    if allowed {
        return Ok(());
    }
    match std::fs::read_dir(directory) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(()),
        Err(error) => Err(Failure::input(format!("{}: {error}", directory.display()))),
        Ok(mut entries) => match entries.next() {
            None => Ok(()),
            Some(_) => Err(Failure::input(format!(
                "{} exists and is not empty; name another --out, or give --force to write into it",
                directory.display()
            ))),
        },
    }
}
