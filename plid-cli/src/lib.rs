//! The `plid` program as a library: the command line, one file per subcommand.

mod bench;
mod directory;
mod export;
mod failure;
mod gap;
mod identify;
mod merge;
mod part;
mod progress;
mod reproduce;
mod run;
mod simulate;
mod sweep;
mod table;
mod validate;
mod voice;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use plid::gap::effects::Library;

use failure::Failure;
use voice::Voice;

/// Pseudo-linear identification: recursive estimation of the states and parameters of a linear plant from measured
/// inputs and outputs.
#[derive(Parser)]
#[command(
    name = "plid",
    version,
    after_help = concat!(
        "Start here:\n",
        "  plid run experiments/truss-mimo-30.toml --out out/truss\n",
        "then open out/truss/report.html. `plid COMMAND --help` explains a command with an example.",
    )
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Suppress progress and remarks; show errors only.
    #[arg(long, global = true)]
    quiet: bool,
    /// Print results as JSON on standard output.
    #[arg(long, global = true)]
    json: bool,
}

#[derive(Subcommand)]
enum Command {
    Run(run::Arguments),
    Sweep(sweep::Arguments),
    Identify(Box<identify::Arguments>),
    Merge(merge::Arguments),
    Simulate(simulate::Arguments),
    Validate(validate::Arguments),
    Bench(bench::Arguments),
    Export(export::Arguments),
    Reproduce(reproduce::Arguments),
    Gap(gap::Arguments),
}

/// Runs the command that the arguments name, and returns the exit status.
///
/// A program of your own may first add forms, expectations and backends to the catalogue with
/// [`Entry::add`](plid::catalogue::Entry::add); experiments and studies then name them like built-in ones.
pub fn main() -> ExitCode {
    main_with(Library::standard())
}

/// Runs the program with effects of your own: `plid gap diagnose`, `plid gap predict` and `plid gap trial` then treat
/// them like the built-in ones.
///
/// ```no_run
/// use plid::gap::effects::{Effect, Library};
///
/// fn program(own: Box<dyn Effect>) -> std::process::ExitCode {
///     plid_cli::main_with(Library::standard().with(own))
/// }
/// ```
pub fn main_with(library: Library) -> ExitCode {
    // clap prints help with status 0 and wrong arguments with status 2 by itself.
    let Cli { command, quiet, json } = Cli::parse();
    let voice = Voice { quiet, json };
    let done = match command {
        Command::Run(arguments) => run::execute(arguments, voice),
        Command::Sweep(arguments) => sweep::execute(&arguments, voice),
        Command::Identify(arguments) => identify::execute(*arguments, voice),
        Command::Merge(arguments) => merge::execute(arguments, voice),
        Command::Simulate(arguments) => simulate::execute(arguments, voice),
        Command::Validate(arguments) => validate::execute(arguments, voice),
        Command::Bench(arguments) => bench::execute(arguments, voice),
        Command::Export(arguments) => export::execute(&arguments, voice),
        Command::Reproduce(arguments) => reproduce::execute(arguments, voice),
        Command::Gap(arguments) => gap::execute(arguments, library, voice),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => ExitCode::from(failure.show()),
    }
}
