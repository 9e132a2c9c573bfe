//! A simulator that is another program, connected by its standard input and output.
//!
//! The program first writes its [`Description`] with `"protocol": 1` as one line of JSON. Then it answers requests
//! until its standard input ends (docs/simulator-protocol.md):
//!
//! - `{"run": {"parameters": [..], "samples": N}}`, a newline and N times the m inputs; the answer is `{"ok": true}`, a
//!   newline and N times the p outputs.
//! - `{"start": {"parameters": [..]}}` and a newline; the answer is `{"ok": true}`, a newline, and displacement and
//!   velocity of each port.
//! - `{"save": {"slot": K}}` and a newline; the answer is `{"ok": true}` and a newline.
//! - `{"restore": {"slot": K}}` and a newline; the answer is that of a start.
//! - The byte `s`, the m inputs and the force at each port, for one step; the answer is the byte `s`, the p outputs,
//!   and displacement and velocity of each port.
//!
//! Numbers are binary, eight bytes each, little endian. Instead of its description or an answer, the program may
//! write `{"error": "why"}` and a newline. The end of its standard error is part of every error message about
//! a failure. [`serve()`] is the other side.

mod answers;
mod process;
mod serve;
mod watch;

use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::{Deserialize, Serialize};

use self::answers::Answers;
use self::process::Process;
pub use self::serve::{own_output, refuse, serve};
use crate::{Channels, Description, Motion, Simulator, SimulatorError};

/// The version of the protocol.
const PROTOCOL: u32 = 1;

/// First byte of a step and of its answer.
const STEP: u8 = b's';

/// A program as a simulator.
pub struct Command {
    command: Vec<String>,
    folder: PathBuf,
    process: Process,
    description: Description,
    /// Buffer for the request of a step.
    sent: Vec<u8>,
    /// Buffer for its answer.
    received: Vec<u8>,
}

/// The first line of a program.
#[derive(Deserialize)]
struct Hello {
    protocol: u32,
    #[serde(flatten)]
    description: serde_json::Value,
}

#[derive(Serialize)]
#[serde(rename_all = "lowercase")]
enum Request<'r> {
    Run { parameters: &'r [f64], samples: usize },
    Start { parameters: &'r [f64] },
    Save { slot: usize },
    Restore { slot: usize },
}

#[derive(Deserialize)]
#[serde(rename_all = "lowercase")]
enum Answer {
    Ok(bool),
    Error(String),
}

impl Command {
    /// Default patience: the time within which a program must read a part of a request or write a part of its answer.
    pub const PATIENCE: Duration = Duration::from_secs(60);

    /// Starts a program with its arguments in a folder, and reads its description. A program that neither reads a
    /// request nor writes its answer for as long as `patience` is stopped. It may take [`Command::PATIENCE`] to start
    /// in any case, because an interpreter loads its libraries first.
    ///
    /// # Errors
    /// Returns [`SimulatorError::Failed`] if the program cannot be started, ends, or writes something other than its
    /// description, and [`SimulatorError::Description`] if the description is inconsistent.
    pub fn start(command: &[String], folder: &Path, patience: Duration) -> Result<Self, SimulatorError> {
        let mut process = Process::start(command, folder, patience.max(Self::PATIENCE))?;
        let line = process.answering(line)?;
        if let Ok(Answer::Error(message)) = parsed(&line) {
            return Err(SimulatorError::failed(message));
        }
        let hello: Hello = parsed(&line).map_err(|message| process.failed(message))?;
        if hello.protocol != PROTOCOL {
            return Err(process.failed(format!("it speaks protocol {}, expected {PROTOCOL}", hello.protocol)));
        }
        let description: Description = serde_json::from_value(hello.description)
            .map_err(|error| process.failed(format!("its description: {error}")))?;
        description.check()?;
        process.set_patience(patience);
        let (m, p, q) = (description.inputs.len(), description.outputs.len(), description.ports.len());
        let (sent, received) = (vec![0; 1 + 8 * (m + q)], vec![0; 8 * (p + 2 * q)]);
        Ok(Self { command: command.into(), folder: folder.into(), process, description, sent, received })
    }

    fn request(&mut self, request: &Request, then: &[u8]) -> Result<(), SimulatorError> {
        let mut text = serde_json::to_vec(request).map_err(|error| SimulatorError::failed(error.to_string()))?;
        text.push(b'\n');
        self.process.send(&[&text, then])
    }

    /// Reads the answer to a request and the numbers after it.
    fn answer(&mut self, numbers: usize) -> Result<Vec<f64>, SimulatorError> {
        let line = self.process.answering(line)?;
        match parsed(&line).map_err(|message| self.process.failed(message))? {
            Answer::Error(message) => Err(SimulatorError::failed(message)),
            Answer::Ok(false) => Err(self.process.failed("it answered that a request failed, without a reason".into())),
            Answer::Ok(true) => {
                let mut bytes = vec![0; 8 * numbers];
                self.process.answering(|input| input.read_exact(&mut bytes))?;
                Ok(bytes.chunks_exact(8).map(number).collect())
            }
        }
    }

    /// Reads the answer to a start, which is the motion at each port.
    fn motions(&mut self) -> Result<Vec<Motion>, SimulatorError> {
        let motions = self.answer(2 * self.description.ports.len())?;
        Ok(motions.chunks_exact(2).map(|both| Motion { displacement: both[0], velocity: both[1] }).collect())
    }

    fn require_states(&self) -> Result<(), SimulatorError> {
        let name = || self.description.name.clone();
        self.description.states.then_some(()).ok_or_else(|| SimulatorError::NoStates { name: name() })
    }
}

/// Reads a line.
fn line(input: &mut BufReader<Answers>) -> std::io::Result<Vec<u8>> {
    let mut line = Vec::new();
    input.read_until(b'\n', &mut line)?;
    if line.is_empty() { Err(std::io::ErrorKind::UnexpectedEof.into()) } else { Ok(line) }
}

/// Longest part of a line that is quoted in a message.
const QUOTED: usize = 80;

/// Reads JSON.
fn parsed<T: for<'d> Deserialize<'d>>(line: &[u8]) -> Result<T, String> {
    serde_json::from_slice(line).map_err(|error| {
        let text: String = String::from_utf8_lossy(line).trim_end().chars().take(QUOTED).collect();
        format!("it wrote {text:?} where a line of JSON is expected ({error})")
    })
}

fn number(bytes: &[u8]) -> f64 {
    bytes.try_into().map_or(f64::NAN, f64::from_le_bytes)
}

fn motion(bytes: &[u8]) -> Motion {
    Motion { displacement: number(&bytes[..8]), velocity: number(&bytes[8..16]) }
}

impl Simulator for Command {
    fn description(&self) -> &Description {
        &self.description
    }

    fn run(&mut self, parameters: &[f64], u: &[Vec<f64>]) -> Result<Channels, SimulatorError> {
        let samples = u.first().map_or(0, Vec::len);
        let inputs: Vec<u8> = (0..samples).flat_map(|k| u.iter().flat_map(move |u| u[k].to_le_bytes())).collect();
        self.request(&Request::Run { parameters, samples }, &inputs)?;
        let p = self.description.outputs.len();
        let y = self.answer(samples * p)?;
        Ok((0..p).map(|o| y.iter().skip(o).step_by(p).copied().collect()).collect())
    }

    fn start(&mut self, parameters: &[f64]) -> Result<Vec<Motion>, SimulatorError> {
        if !self.description.has_steps() {
            return Err(SimulatorError::NoSteps { name: self.description.name.clone() });
        }
        self.request(&Request::Start { parameters }, &[])?;
        self.motions()
    }

    fn save(&mut self, slot: usize) -> Result<(), SimulatorError> {
        self.require_states()?;
        self.request(&Request::Save { slot }, &[])?;
        self.answer(0).map(drop)
    }

    fn restore(&mut self, slot: usize) -> Result<Vec<Motion>, SimulatorError> {
        self.require_states()?;
        self.request(&Request::Restore { slot }, &[])?;
        self.motions()
    }

    /// Starts another instance of the program.
    fn another(&self) -> Result<Option<Box<dyn Simulator>>, SimulatorError> {
        let another = Self::start(&self.command, &self.folder, self.process.patience())?;
        if another.description == self.description {
            return Ok(Some(Box::new(another)));
        }
        Err(another.process.failed("a second instance of it has another description".into()))
    }

    fn step(&mut self, u: &[f64], forces: &[f64], y: &mut [f64], motions: &mut [Motion]) -> Result<(), SimulatorError> {
        self.sent[0] = STEP;
        for (to, from) in self.sent[1..].chunks_exact_mut(8).zip(u.iter().chain(forces)) {
            to.copy_from_slice(&from.to_le_bytes());
        }
        let Self { process, sent, received, .. } = self;
        process.send(&[sent])?;
        let mut first = [0];
        process.answering(|input| input.read_exact(&mut first))?;
        if first[0] != STEP {
            let rest = process.answering(line)?;
            let line = [&first[..], &rest].concat();
            return match parsed(&line).map_err(|message| process.failed(message))? {
                Answer::Error(message) => Err(SimulatorError::failed(message)),
                Answer::Ok(_) => Err(process.failed("it answered a step without numbers".into())),
            };
        }
        process.answering(|input| input.read_exact(received))?;
        let (outputs, seen) = received.split_at(8 * y.len());
        y.iter_mut().zip(outputs.chunks_exact(8)).for_each(|(y, bytes)| *y = number(bytes));
        motions.iter_mut().zip(seen.chunks_exact(16)).for_each(|(to, bytes)| *to = motion(bytes));
        Ok(())
    }
}
