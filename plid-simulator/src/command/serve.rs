//! The other side of the protocol, which serves a simulator to another program.

use std::fs::File;
use std::io::{BufRead, BufReader, BufWriter, ErrorKind, Read, Write};

use serde::{Deserialize, Serialize};

use super::{PROTOCOL, STEP, number};
use crate::{Channels, Checked, Description, Motion, Simulator, SimulatorError};

/// The first line.
#[derive(Serialize)]
struct Hello<'d> {
    protocol: u32,
    #[serde(flatten)]
    description: &'d Description,
}

#[derive(Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
enum Request {
    Run { parameters: Vec<f64>, samples: usize },
    Start { parameters: Vec<f64> },
    Save { slot: usize },
    Restore { slot: usize },
}

/// Longest request in JSON.
const LONGEST: u64 = 1 << 20;

/// Number of bytes that are read together.
const CHUNK: usize = 1 << 16;

/// Serves a simulator to [`crate::Command`] over two streams until `input` ends (docs/simulator-protocol.md).
///
/// # Errors
/// Returns an error if a stream fails or `input` does not follow the protocol. A failure of the simulator is an answer,
/// not an error.
pub fn serve(simulator: &mut dyn Simulator, input: impl Read, output: impl Write) -> std::io::Result<()> {
    let mut output = BufWriter::new(output);
    let description = simulator.description().clone();
    if let Err(error) = description.check() {
        return refuse(output, &error.to_string());
    }
    say(&mut output, &Hello { protocol: PROTOCOL, description: &description })?;
    let (p, q) = (description.outputs.len(), description.ports.len());
    let server = Server {
        simulator,
        input: BufReader::new(input),
        output,
        request: vec![0; 8 * (description.inputs.len() + q)],
        u: vec![0.0; description.inputs.len()],
        forces: vec![0.0; q],
        y: vec![0.0; p],
        motions: vec![Motion::default(); q],
        description,
    };
    server.run()
}

/// Reports to [`crate::Command`] why there is no simulator.
///
/// # Errors
/// Returns an error if the stream fails.
pub fn refuse(mut output: impl Write, why: &str) -> std::io::Result<()> {
    say(&mut output, &serde_json::json!({ "error": why }))
}

/// Returns a handle of standard output that remains valid when standard output is redirected. A program uses it for the
/// protocol and redirects everything else that is printed.
///
/// # Errors
/// Returns an error if the system has no handle left.
#[cfg(unix)]
pub fn own_output() -> std::io::Result<File> {
    use std::os::fd::AsFd;
    Ok(File::from(std::io::stdout().as_fd().try_clone_to_owned()?))
}

/// Returns a handle of standard output that remains valid when standard output is redirected. A program uses it for the
/// protocol and redirects everything else that is printed.
///
/// # Errors
/// Returns an error if the system has no handle left.
#[cfg(not(unix))]
pub fn own_output() -> std::io::Result<File> {
    use std::os::windows::io::AsHandle;
    Ok(File::from(std::io::stdout().as_handle().try_clone_to_owned()?))
}

/// Writes a line of JSON.
fn say(output: &mut impl Write, what: &impl Serialize) -> std::io::Result<()> {
    serde_json::to_writer(&mut *output, what)?;
    output.write_all(b"\n")?;
    output.flush()
}

struct Server<'s, I, O> {
    simulator: &'s mut dyn Simulator,
    description: Description,
    input: I,
    output: O,
    /// The numbers of a request for a step.
    request: Vec<u8>,
    u: Vec<f64>,
    forces: Vec<f64>,
    y: Vec<f64>,
    motions: Vec<Motion>,
}

impl<I: BufRead, O: Write> Server<'_, I, O> {
    fn run(mut self) -> std::io::Result<()> {
        loop {
            match self.input.fill_buf()?.first() {
                None => return Ok(()),
                Some(&STEP) => self.step()?,
                Some(_) => self.line()?,
            }
        }
    }

    fn step(&mut self) -> std::io::Result<()> {
        self.input.consume(1);
        self.input.read_exact(&mut self.request)?;
        let mut numbers = self.request.chunks_exact(8).map(number);
        self.u.iter_mut().chain(&mut self.forces).zip(&mut numbers).for_each(|(to, number)| *to = number);
        match self.simulator.step(&self.u, &self.forces, &mut self.y, &mut self.motions) {
            Ok(()) => {
                self.output.write_all(&[STEP])?;
                write(&mut self.output, self.y.iter().copied())?;
                write(&mut self.output, numbers_of(&self.motions))?;
                self.output.flush()
            }
            Err(error) => refuse(&mut self.output, &message(error)),
        }
    }

    /// Answers a request in JSON.
    fn line(&mut self) -> std::io::Result<()> {
        let mut line = Vec::new();
        (&mut self.input).take(LONGEST).read_until(b'\n', &mut line)?;
        let wrong = |error| std::io::Error::new(ErrorKind::InvalidData, format!("a request is not JSON: {error}"));
        match serde_json::from_slice(&line).map_err(wrong)? {
            Request::Start { parameters } => {
                let known = self.parameters(&parameters);
                let motions = known.and_then(|()| self.simulator.start(&parameters));
                self.answer_motions(motions)
            }
            Request::Save { slot } => {
                let motions = self.simulator.save(slot).map(|()| Vec::new());
                self.answer_motions(motions)
            }
            Request::Restore { slot } => {
                let motions = self.simulator.restore(slot);
                self.answer_motions(motions)
            }
            Request::Run { parameters, samples } => {
                let u = self.inputs(samples)?;
                match self.parameters(&parameters).and_then(|()| self.whole(&parameters, &u)) {
                    Ok(y) => {
                        let samples = y.first().map_or(0, Vec::len);
                        self.answer((0..samples).flat_map(|k| y.iter().map(move |y| y[k])))
                    }
                    Err(error) => refuse(&mut self.output, &message(error)),
                }
            }
        }
    }

    /// Carries out a run, and checks the number of outputs and samples.
    fn whole(&mut self, parameters: &[f64], u: &[Vec<f64>]) -> Result<Channels, SimulatorError> {
        Checked::new(self.simulator)?.run(parameters, u).map_err(|error| match error {
            // The other side counts the calls.
            SimulatorError::Call { source, .. } => *source,
            error => error,
        })
    }

    fn parameters(&self, given: &[f64]) -> Result<(), SimulatorError> {
        let (found, expected) = (given.len(), self.description.parameters.len());
        let message = || SimulatorError::failed(format!("{found} parameters are given, expected {expected}"));
        (found == expected).then_some(()).ok_or_else(message)
    }

    /// Reads the inputs of a run. Memory is allocated for the numbers that arrive, not for the announced count.
    fn inputs(&mut self, samples: usize) -> std::io::Result<Channels> {
        let m = self.u.len();
        let mut u: Channels = vec![Vec::new(); m];
        let (mut left, mut at) = (samples.saturating_mul(8 * m), 0);
        let mut bytes = vec![0; CHUNK];
        while left > 0 {
            let part = &mut bytes[..left.min(CHUNK)];
            self.input.read_exact(part)?;
            left -= part.len();
            for value in part.chunks_exact(8).map(number) {
                u[at % m].push(value);
                at += 1;
            }
        }
        Ok(u)
    }

    fn answer_motions(&mut self, motions: Result<Vec<Motion>, SimulatorError>) -> std::io::Result<()> {
        match motions {
            Ok(motions) => self.answer(numbers_of(&motions)),
            Err(error) => refuse(&mut self.output, &message(error)),
        }
    }

    fn answer(&mut self, numbers: impl Iterator<Item = f64>) -> std::io::Result<()> {
        self.output.write_all(b"{\"ok\": true}\n")?;
        write(&mut self.output, numbers)?;
        self.output.flush()
    }
}

fn write(output: &mut impl Write, mut numbers: impl Iterator<Item = f64>) -> std::io::Result<()> {
    numbers.try_for_each(|number| output.write_all(&number.to_le_bytes()))
}

fn numbers_of(motions: &[Motion]) -> impl Iterator<Item = f64> {
    motions.iter().flat_map(|motion| [motion.displacement, motion.velocity])
}

/// Returns the message of a simulator's failure.
fn message(error: SimulatorError) -> String {
    match error {
        SimulatorError::Failed { message } => message,
        error => error.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Input, Output, Parameter, Port};

    /// A gain with a port whose motion is the force; it fails above 10.
    struct Gain {
        description: Description,
        gain: f64,
    }

    impl Gain {
        fn new() -> Self {
            let (inputs, outputs) = (vec![Input::new("a"), Input::new("b")], vec![Output::new("y")]);
            let mut description = Description::new("gain", 10.0, inputs, outputs);
            description.ports.push(Port::new("port"));
            description.parameters.push(Parameter::new("gain", 2.0));
            description.steps_per_sample = 1;
            Self { description, gain: 0.0 }
        }
    }

    impl Simulator for Gain {
        fn description(&self) -> &Description {
            &self.description
        }

        fn start(&mut self, parameters: &[f64]) -> Result<Vec<Motion>, SimulatorError> {
            self.gain = parameters[0];
            Ok(vec![Motion { displacement: 0.25, velocity: 0.5 }])
        }

        fn step(&mut self, u: &[f64], f: &[f64], y: &mut [f64], at: &mut [Motion]) -> Result<(), SimulatorError> {
            if u[0] > 10.0 {
                return Err(SimulatorError::failed("too \"loud\""));
            }
            y[0] = self.gain * (u[0] - u[1]);
            at[0] = Motion { displacement: f[0], velocity: -f[0] };
            Ok(())
        }
    }

    /// Lines and numbers of a conversation.
    enum Part {
        Line(&'static str),
        Byte(u8),
        Numbers(&'static [f64]),
    }
    use Part::{Byte, Line, Numbers};

    fn bytes(parts: &[Part]) -> Vec<u8> {
        let of = |part: &Part| match part {
            Line(text) => format!("{text}\n").into_bytes(),
            Byte(byte) => vec![*byte],
            Numbers(numbers) => numbers.iter().flat_map(|number| number.to_le_bytes()).collect(),
        };
        parts.iter().flat_map(of).collect()
    }

    /// Returns the data after the description.
    fn served(requests: &[Part]) -> (Vec<u8>, std::io::Result<()>) {
        let mut answers = Vec::new();
        let result = serve(&mut Gain::new(), &bytes(requests)[..], &mut answers);
        let end = answers.iter().position(|byte| *byte == b'\n').unwrap() + 1;
        let hello: serde_json::Value = serde_json::from_slice(&answers[..end]).unwrap();
        assert_eq!((&hello["protocol"], &hello["name"]), (&1.into(), &"gain".into()));
        (answers.split_off(end), result)
    }

    #[test]
    fn requests_are_answered_in_turn() {
        let (answers, result) = served(&[
            Line(r#"{"run": {"parameters": [3.0], "samples": 2}}"#),
            Numbers(&[1.0, 0.5, 2.0, 0.0]),
            Line(r#"{"start": {"parameters": [4.0]}}"#),
            Byte(STEP),
            Numbers(&[1.0, 0.0, 0.125]),
            Byte(STEP),
            Numbers(&[11.0, 0.0, 0.0]),
            Byte(STEP),
            Numbers(&[2.0, 0.0, 0.0]),
        ]);
        let expected = bytes(&[
            Line(r#"{"ok": true}"#),
            Numbers(&[1.5, 6.0]),
            Line(r#"{"ok": true}"#),
            Numbers(&[0.25, 0.5]),
            Byte(STEP),
            Numbers(&[4.0, 0.125, -0.125]),
            Line(r#"{"error":"too \"loud\""}"#),
            Byte(STEP),
            Numbers(&[8.0, 0.0, -0.0]),
        ]);
        assert_eq!(answers, expected);
        result.unwrap();
    }

    #[test]
    fn what_does_not_follow_the_protocol_ends_it() {
        let (answers, result) = served(&[Line(r#"{"start": {"parameters": []}}"#), Line("hello")]);
        assert_eq!(answers, b"{\"error\":\"0 parameters are given, expected 1\"}\n");
        assert!(result.unwrap_err().to_string().contains("a request is not JSON"));
        let (_, result) = served(&[Byte(STEP), Numbers(&[1.0])]);
        assert_eq!(result.unwrap_err().kind(), ErrorKind::UnexpectedEof);
    }
}
