use plid_simulator::PortVariables;
use serde::{Deserialize, Serialize};

/// The channels, parameters and ports of an FMU, and its rate.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Options {
    /// Samples per second. If absent, a sample is one step of the FMU's default experiment.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rate_hz: Option<f64>,
    /// Number of steps in a sample. If absent, it is the number of steps of the default experiment in a sample with
    /// ports, and 1 without ports.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub steps_per_sample: Option<usize>,
    /// The inputs, by name. If absent, these are all real inputs except those that take the force of a port, or all
    /// real inputs if each of them takes one. An input that is left out keeps its start value.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub inputs: Option<Vec<String>>,
    /// The outputs, by name. If absent, all real outputs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub outputs: Option<Vec<String>>,
    /// The parameters that may be wrong.
    pub parameters: Vec<ChosenParameter>,
    /// The places that take a force.
    pub ports: Vec<PortVariables>,
}

/// A parameter of an FMU that may be wrong. Absent values are taken from the FMU.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChosenParameter {
    /// Its name.
    pub name: String,
    /// Its value in the simulator as given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub value: Option<f64>,
    /// The smallest value that the simulator accepts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lower: Option<f64>,
    /// The largest value that the simulator accepts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub upper: Option<f64>,
    /// Largest expected error of the value (two standard deviations). A smaller error is not named as a cause.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limit: Option<f64>,
    /// Its unit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
}

impl ChosenParameter {
    /// Creates a parameter with the value, bounds and unit of the FMU.
    pub fn new(name: impl Into<String>) -> Self {
        Self { name: name.into(), ..Self::default() }
    }
}
