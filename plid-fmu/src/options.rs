use plid_simulator::PortVariables;
use serde::{Deserialize, Serialize};

/// What is taken from an FMU, and how it is run.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Options {
    /// Samples per second. If absent, a sample is one step of the FMU's default experiment.
    pub rate_hz: Option<f64>,
    /// Number of steps in a sample. If absent: with ports, the number of steps of the default experiment in a sample;
    /// without ports 1.
    pub steps_per_sample: Option<usize>,
    /// The inputs, by name. If absent, all real inputs but those that only take the force of a port; if each of them
    /// takes one, all. An input that is left out keeps its start value.
    pub inputs: Option<Vec<String>>,
    /// The outputs, by name. If absent, all real outputs.
    pub outputs: Option<Vec<String>>,
    /// The parameters that may be wrong.
    pub parameters: Vec<ChosenParameter>,
    /// The places that take a force.
    pub ports: Vec<PortVariables>,
}

/// A parameter of an FMU that may be wrong. What is absent is taken from the FMU.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChosenParameter {
    /// Its name.
    pub name: String,
    /// Its value in the simulator as given.
    #[serde(default)]
    pub value: Option<f64>,
    /// The least value that the simulator takes.
    #[serde(default)]
    pub lower: Option<f64>,
    /// The largest value that the simulator takes.
    #[serde(default)]
    pub upper: Option<f64>,
    /// Largest error of the value that is no cause: two standard deviations.
    #[serde(default)]
    pub limit: Option<f64>,
    /// Its unit.
    #[serde(default)]
    pub unit: Option<String>,
}

impl ChosenParameter {
    /// The parameter as the FMU has it.
    pub fn new(name: impl Into<String>) -> Self {
        Self { name: name.into(), ..Self::default() }
    }
}
