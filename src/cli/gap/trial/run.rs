use std::path::PathBuf;
use std::process::{Command, Stdio};

use plid_trial::{Extent, config_of};

use super::{Failure, Voice, Which, diagnose, directory, draw, score};

/// Draw, diagnose and score: DIR/trial, DIR/sealed, DIR/report.html.
///
/// The diagnosis runs in a process of its own, which is given DIR/trial alone.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  plid gap trial run --quick --out out/trial\n  plid gap trial run experiments/trials/standard.toml --out out/standard --resume"
)]
pub struct Arguments {
    #[command(flatten)]
    which: Which,
    /// Where everything goes.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Draws the same cases again; from the system if left out.
    #[arg(long, conflicts_with = "resume")]
    seed: Option<u64>,
    /// Cases at a time; as many as there are cores if left out.
    #[arg(long, value_name = "J")]
    jobs: Option<usize>,
    /// Go on with the cases that were drawn into DIR before; answers that stand there are not given again.
    #[arg(long)]
    resume: bool,
}

/// Runs the command.
pub fn execute(arguments: &Arguments, voice: Voice) -> Result<(), Failure> {
    let config = arguments.which.read()?;
    let jobs = diagnose::jobs(arguments.jobs)?;
    let out = &arguments.out;
    let (trial, sealed) = (out.join("trial"), out.join("sealed"));
    if arguments.resume {
        if config_of(&sealed)? != config {
            return Err(Failure::input(format!("--resume: {} holds another trial", out.display())));
        }
    } else {
        directory::with(out, || draw::into(&config, arguments.seed, &trial, &sealed, voice))?;
    }
    let program = std::env::current_exe().map_err(Failure::work)?;
    let mut command = Command::new(program);
    command.args(["gap", "trial", "diagnose"]).arg(&trial).args(["--jobs", &jobs.to_string()]);
    command.args(["--quiet"].iter().filter(|_| voice.quiet || voice.json));
    // What it prints is no result of this command.
    let status = command.stdout(Stdio::null()).status().map_err(Failure::work)?;
    if !status.success() {
        return Err(Failure::work(format!("the diagnosis ended with {status}; --resume goes on from what is done")));
    }
    score::into(&trial, &sealed, Extent::Whole, out, voice)
}
