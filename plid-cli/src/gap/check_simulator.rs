use std::path::{Path, PathBuf};
use std::time::Duration;

use plid::gap::GapError;
use plid::gap::case::CaseConfig;
use plid::lab::data::config;
use plid::simulator::{Command, Finding, Simulator, check};

use super::{Failure, Voice, in_loop, voice};

/// Check a simulator before it is used in a diagnosis.
///
/// Starts the program of a case, or one that is given after `--`, and tells what it does not honour: equal runs give
/// equal outputs, steps give what a run gives, each parameter changes something, and a force moves its port. Exit
/// status 1 if a diagnosis cannot use it.
#[derive(clap::Args)]
#[command(
    override_usage = "plid gap check-simulator CASE.toml\n       plid gap check-simulator -- PROGRAM [ARGUMENT]...",
    after_help = "Example:\n  plid gap check-simulator -- python3 examples/simulator/oscillator.py\n\n\
                  A template in Python is in examples/simulator, and the protocol in docs/simulator-protocol.md."
)]
pub struct Arguments {
    /// A case with `[simulator]`.
    #[arg(value_name = "CASE.toml", conflicts_with = "command", required_unless_present = "command")]
    case: Option<PathBuf>,
    /// Size of the trial inputs.
    #[arg(long, value_name = "SIZE", default_value_t = 1.0)]
    size: f64,
    /// The program and its arguments.
    #[arg(last = true, value_name = "PROGRAM")]
    command: Vec<String>,
}

/// Runs the command.
pub fn execute(arguments: &Arguments, voice: Voice) -> Result<(), Failure> {
    let mut simulator = match &arguments.case {
        Some(case) => {
            let read: CaseConfig = config::read_checked(case, CaseConfig::problems).map_err(GapError::from)?;
            let Some(simulator) = &read.simulator else {
                return Err(Failure::input(format!("{}: it has no [simulator]", case.display())));
            };
            in_loop::start(simulator, case)?
        }
        None => Command::start(&arguments.command, Path::new("."), Duration::from_secs(60)).map_err(GapError::from)?,
    };
    let findings = check(&mut simulator, arguments.size).map_err(GapError::from)?;
    let sound = findings.iter().all(|finding| finding.holds || !finding.required);
    if voice.json {
        let said = serde_json::json!({ "simulator": simulator.description(), "findings": findings, "sound": sound });
        voice::print(&format!("{said}\n"))?;
    } else if !voice.quiet {
        voice::print(&text(simulator.description(), &findings))?;
    }
    if sound { Ok(()) } else { Err(Failure::work("a diagnosis cannot use this simulator as it is")) }
}

fn text(description: &plid::simulator::Description, findings: &[Finding]) -> String {
    let count = |count: usize, what: &str| format!("{count} {what}{}", if count == 1 { "" } else { "s" });
    let mut text = format!(
        "{}: {} Hz, {}, {}, {}, {}\n",
        description.name,
        description.rate_hz,
        count(description.inputs.len(), "input"),
        count(description.outputs.len(), "output"),
        count(description.ports.len(), "port"),
        count(description.parameters.len(), "parameter")
    );
    let width = findings.iter().map(|finding| finding.what.len()).max().unwrap_or(0);
    for Finding { what, required, holds, found } in findings {
        let mark = if *holds {
            "ok  "
        } else if *required {
            "FAIL"
        } else {
            "note"
        };
        text += &format!("{mark}  {what:width$}  {found}\n");
    }
    text
}
