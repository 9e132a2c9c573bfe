use std::path::{Path, PathBuf};

use plid::gap::GapError;
use plid::gap::case::CaseConfig;
use plid::lab::data::config;
use plid::simulator::{Command, Finding, Simulator, check};

use super::serve_fmu::Choice;
use super::{Failure, Voice, in_loop, voice};

/// Check a simulator before it is used in a diagnosis.
///
/// Starts the simulator of a case, an FMU, or a program that is given after `--`, and reports which rules it
/// violates. The rules are: equal runs give equal outputs, steps give the same outputs as a run, each parameter
/// changes something, and a force moves its port. The exit status is 1 if a diagnosis cannot use the simulator.
#[derive(clap::Args)]
#[command(
    override_usage = "plid gap check-simulator CASE.toml\n       plid gap check-simulator [OPTIONS] MODEL.fmu\n       \
                      plid gap check-simulator -- PROGRAM [ARGUMENT]...",
    after_help = "Examples:\n  plid gap check-simulator -- python3 examples/simulator/oscillator.py\n  \
                  plid gap check-simulator model.fmu --rate 200 --parameter mass\n\n\
                  A template in Python is in examples/simulator, and the protocol in docs/simulator-protocol.md."
)]
pub struct Arguments {
    /// A case with `[simulator]`, or an FMU.
    #[arg(value_name = "CASE.toml|MODEL.fmu", conflicts_with = "command", required_unless_present = "command")]
    file: Option<PathBuf>,
    /// Size of the trial inputs.
    #[arg(long, value_name = "SIZE", default_value_t = 1.0)]
    size: f64,
    /// The program and its arguments.
    #[arg(last = true, value_name = "PROGRAM")]
    command: Vec<String>,
    #[command(flatten, next_help_heading = "For an FMU")]
    choice: Choice,
}

impl Arguments {
    fn start(&self) -> Result<Command, Failure> {
        let is_fmu = |file: &Path| file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("fmu"));
        let (here, patience) = (Path::new("."), Command::PATIENCE);
        match &self.file {
            Some(file) if is_fmu(file) => Ok(self.choice.start(file, here, patience)?),
            _ if !self.choice.is_empty() => {
                Err(Failure::input("parameters, ports, channels and rates are chosen for an FMU only"))
            }
            None => Ok(Command::start(&self.command, here, patience).map_err(GapError::from)?),
            Some(file) => {
                let read: CaseConfig = config::read_checked(file, CaseConfig::problems).map_err(GapError::from)?;
                let Some(simulator) = &read.simulator else {
                    return Err(Failure::input(format!("{}: it has no [simulator]", file.display())));
                };
                Ok(in_loop::start(&read, simulator, file)?)
            }
        }
    }
}

/// Runs the command.
pub fn execute(arguments: &Arguments, voice: Voice) -> Result<(), Failure> {
    let mut simulator = arguments.start()?;
    let findings = check(&mut simulator, arguments.size).map_err(GapError::from)?;
    let sound = findings.iter().all(|finding| finding.holds || !finding.required);
    if voice.json {
        let said = serde_json::json!({ "simulator": simulator.description(), "findings": findings, "sound": sound });
        voice::print(&format!("{said}\n"))?;
    } else if !voice.quiet {
        voice::print(&text(simulator.description(), &findings))?;
    }
    if sound { Ok(()) } else { Err(Failure::work("a diagnosis cannot use this simulator in its present state")) }
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
