use std::fmt;

use crate::case::ON_A_MODE;
use crate::plant::plain_hz;

/// The location at which an effect acts. Channels count from zero here and are written by name.
#[derive(Debug, Clone, PartialEq)]
pub enum Place {
    /// One input, or the port of one input.
    Input(usize),
    /// All inputs equally.
    AllInputs,
    /// The loop that an input commands, and that drives the port of this input.
    Loop(usize),
    /// From one input into another.
    InputToInput(usize, usize),
    /// One output.
    Output(usize),
    /// From one output into another.
    OutputToOutput(usize, usize),
    /// A port that belongs to no input (its number): declared, or on a single mode.
    Port(usize),
    /// One mode of the simulation, by its number.
    Mode(usize),
    /// The whole structure.
    Structure,
    /// The frequency of a missing mode in Hz.
    MissingMode(f64),
    /// One parameter of the engineer's own simulator, by its number.
    Parameter(usize),
    /// The frequency in Hz of a disturbance, and the port at which it enters.
    Frequency(f64, usize),
}

/// Names of locations.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Names {
    /// Names of the inputs.
    pub inputs: Vec<String>,
    /// Names of the outputs.
    pub outputs: Vec<String>,
    /// Names of the ports.
    pub ports: Vec<String>,
    /// Frequencies of the modes in Hz.
    pub modes_hz: Vec<f64>,
    /// Names of the parameters of the engineer's own simulator.
    pub parameters: Vec<String>,
}

impl Place {
    /// Returns the location as in diagnosis.json.
    pub fn location(&self, names: &Names) -> String {
        Located { place: self, names }.to_string()
    }
}

struct Located<'a> {
    place: &'a Place,
    names: &'a Names,
}

impl fmt::Display for Located<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = self.names;
        match *self.place {
            Place::Input(i) => write!(f, "input:{}", names.inputs[i]),
            Place::Loop(i) => write!(f, "loop:{}", names.inputs[i]),
            Place::AllInputs => f.write_str("input:all"),
            Place::InputToInput(i, j) => write!(f, "input:{}->{}", names.inputs[i], names.inputs[j]),
            Place::Output(o) => write!(f, "output:{}", names.outputs[o]),
            Place::OutputToOutput(o, q) => write!(f, "output:{}->{}", names.outputs[o], names.outputs[q]),
            Place::Port(k) if names.ports[k].starts_with(ON_A_MODE) => f.write_str(&names.ports[k]),
            Place::Port(k) => write!(f, "port:{}", names.ports[k]),
            Place::Mode(k) => write!(f, "mode:{}", plain_hz(names.modes_hz[k])),
            Place::Parameter(k) => write!(f, "parameter:{}", names.parameters[k]),
            Place::Structure => f.write_str("structure"),
            Place::MissingMode(hz) => write!(f, "mode:{}", plain_hz(hz)),
            Place::Frequency(hz, _) => write!(f, "freq:{}", plain_hz(hz)),
        }
    }
}
