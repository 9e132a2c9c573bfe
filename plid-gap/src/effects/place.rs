use std::fmt;

/// Where an effect acts. Channels count from zero here and are written by name.
#[derive(Debug, Clone, PartialEq)]
pub enum Place {
    /// One input, or the strut of one input.
    Input(usize),
    /// All inputs alike.
    AllInputs,
    /// From one input into another.
    InputToInput(usize, usize),
    /// One output.
    Output(usize),
    /// From one output into another.
    OutputToOutput(usize, usize),
    /// A declared port that no input has (its number).
    Port(usize),
    /// One mode of the simulation, by its number.
    Mode(usize),
    /// The whole structure.
    Structure,
    /// A frequency in Hz: of a mode that is missing.
    MissingMode(f64),
    /// A frequency in Hz: of a disturbance that enters at a port.
    Frequency(f64, usize),
}

/// Names for places.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Names {
    /// Of the inputs.
    pub inputs: Vec<String>,
    /// Of the outputs.
    pub outputs: Vec<String>,
    /// Of the ports.
    pub ports: Vec<String>,
    /// Of the modes, in Hz.
    pub modes_hz: Vec<f64>,
}

impl Place {
    /// As diagnosis.json says it.
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
            Place::AllInputs => f.write_str("input:all"),
            Place::InputToInput(i, j) => write!(f, "input:{}->{}", names.inputs[i], names.inputs[j]),
            Place::Output(o) => write!(f, "output:{}", names.outputs[o]),
            Place::OutputToOutput(o, q) => write!(f, "output:{}->{}", names.outputs[o], names.outputs[q]),
            Place::Port(k) => write!(f, "port:{}", names.ports[k]),
            Place::Mode(k) => write!(f, "mode:{:.1}", names.modes_hz[k]),
            Place::Structure => f.write_str("structure"),
            Place::MissingMode(hz) => write!(f, "mode:{hz:.1}"),
            Place::Frequency(hz, _) => write!(f, "freq:{hz:.1}"),
        }
    }
}
