use std::path::PathBuf;
use std::process::{Command, Stdio};

use plid::gap::effects::Library;
use plid_trial::{Extent, config_of};

use super::{Failure, Voice, Which, diagnose, directory, draw, score};

/// Draw, diagnose and score: DIR/trial, DIR/sealed, DIR/report.html.
///
/// The diagnosis runs in a separate process that knows only DIR/trial.
#[derive(clap::Args)]
#[command(
    after_help = concat!(
        "Examples:\n",
        "  plid gap trial run --quick --out out/trial\n",
        "  plid gap trial run experiments/trials/standard.toml --out out/standard --resume",
    )
)]
pub struct Arguments {
    #[command(flatten)]
    which: Which,
    /// Output directory.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Seed of the draw [default: from the system].
    #[arg(long, conflicts_with = "resume")]
    seed: Option<u64>,
    /// Number of cases diagnosed at a time [default: number of cores].
    #[arg(long, value_name = "J")]
    jobs: Option<usize>,
    /// Continue with the cases drawn into DIR earlier; existing answers are kept.
    #[arg(long)]
    resume: bool,
}

/// Runs the command.
pub fn execute(arguments: &Arguments, library: &Library, voice: Voice) -> Result<(), Failure> {
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
    // Its output is not a result of this command.
    let status = command.stdout(Stdio::null()).status().map_err(Failure::work)?;
    if !status.success() {
        return Err(Failure::work(format!(
            "the diagnosis ended with {status}; --resume continues with the cases that remain"
        )));
    }
    score::into(&trial, &sealed, Extent::Whole, library, out, voice)
}
