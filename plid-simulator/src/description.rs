use plid_model::OutputKind;
use serde::{Deserialize, Serialize};

use crate::SimulatorError;

/// The description of a simulator: its channels, ports, parameters and rate.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Description {
    /// Name of the simulator in messages and reports.
    pub name: String,
    /// Samples per second of inputs and outputs.
    pub rate_hz: f64,
    /// The inputs (m).
    pub inputs: Vec<Input>,
    /// The outputs (p).
    pub outputs: Vec<Output>,
    /// The places at which a force can act. Only a simulator with steps has ports.
    #[serde(default)]
    pub ports: Vec<Port>,
    /// The numbers that may be wrong.
    #[serde(default)]
    pub parameters: Vec<Parameter>,
    /// Number of steps in a sample; zero for a simulator that only has whole runs.
    #[serde(default)]
    pub steps_per_sample: usize,
    /// Whether it can store its state between two steps and return to it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub states: bool,
}

/// An input of a simulator.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Input {
    /// Its name.
    pub name: String,
    /// Its unit, if it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
}

/// An output of a simulator.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Output {
    /// Its name.
    pub name: String,
    /// The quantity that it measures, if it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kind: Option<OutputKind>,
    /// Its unit, if it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
}

/// A place of a simulator with a displacement and a velocity, at which a force can act.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Port {
    /// Its name.
    pub name: String,
    /// The input that acts at the same place, if there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub input: Option<String>,
    /// Unit of the force, if it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub force_unit: Option<String>,
    /// Unit of the displacement, if it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub displacement_unit: Option<String>,
}

/// A number of a simulator that may be wrong.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Parameter {
    /// Its name.
    pub name: String,
    /// Its value in the simulator as given.
    pub value: f64,
    /// Its unit, if it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// The smallest value that the simulator accepts, if there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lower: Option<f64>,
    /// The largest value that the simulator accepts, if there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub upper: Option<f64>,
    /// Largest expected error of the value, in its unit (two standard deviations). A smaller error is not named as a
    /// cause. If absent, any material error is a cause.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limit: Option<f64>,
}

impl Input {
    /// Creates an input without a unit.
    pub fn new(name: impl Into<String>) -> Self {
        Self { name: name.into(), unit: None }
    }
}

impl Output {
    /// Creates an output of unknown kind and unit.
    pub fn new(name: impl Into<String>) -> Self {
        Self { name: name.into(), kind: None, unit: None }
    }
}

impl Port {
    /// Creates a port without an input at the same place and without units.
    pub fn new(name: impl Into<String>) -> Self {
        Self { name: name.into(), input: None, force_unit: None, displacement_unit: None }
    }
}

impl Parameter {
    /// Creates a parameter without unit, bounds and limit.
    pub fn new(name: impl Into<String>, value: f64) -> Self {
        Self { name: name.into(), value, unit: None, lower: None, upper: None, limit: None }
    }

    /// Returns the value within the bounds that is nearest to `value`.
    pub fn bounded(&self, value: f64) -> f64 {
        value.max(self.lower.unwrap_or(f64::NEG_INFINITY)).min(self.upper.unwrap_or(f64::INFINITY))
    }
}

impl Description {
    /// Creates the description of a simulator without ports and parameters, which only has whole runs.
    pub fn new(name: impl Into<String>, rate_hz: f64, inputs: Vec<Input>, outputs: Vec<Output>) -> Self {
        let (name, ports, parameters) = (name.into(), Vec::new(), Vec::new());
        Self { name, rate_hz, inputs, outputs, ports, parameters, steps_per_sample: 0, states: false }
    }

    /// Returns the values of the parameters in the simulator as given.
    pub fn values(&self) -> Vec<f64> {
        self.parameters.iter().map(|parameter| parameter.value).collect()
    }

    /// Returns whether the simulator can advance by one step at a time.
    pub fn has_steps(&self) -> bool {
        self.steps_per_sample > 0
    }

    /// Checks names, numbers and bounds.
    ///
    /// # Errors
    /// Returns [`SimulatorError::Description`] with the first fault.
    pub fn check(&self) -> Result<(), SimulatorError> {
        self.fault().map_or(Ok(()), |message| Err(SimulatorError::Description { name: self.name.clone(), message }))
    }

    fn fault(&self) -> Option<String> {
        // At a rate of 1e-320 a sample has no finite length.
        if !(1e-12..=1e15).contains(&self.rate_hz) {
            return Some(format!("rate_hz = {} is not between 1e-12 and 1e15", self.rate_hz));
        }
        if self.outputs.is_empty() {
            return Some("it has no output".into());
        }
        if !self.ports.is_empty() && !self.has_steps() {
            return Some("it has ports, but steps_per_sample is 0: forces act only in steps".into());
        }
        if self.states && !self.has_steps() {
            return Some("it stores states, but steps_per_sample is 0: states exist only between steps".into());
        }
        let inputs: Vec<&str> = self.inputs.iter().map(|input| input.name.as_str()).collect();
        let outputs = self.outputs.iter().map(|output| output.name.as_str()).collect();
        let ports = self.ports.iter().map(|port| port.name.as_str()).collect();
        let parameters = self.parameters.iter().map(|parameter| parameter.name.as_str()).collect();
        let lists = [("inputs", inputs.clone()), ("outputs", outputs), ("ports", ports), ("parameters", parameters)];
        lists
            .iter()
            .find_map(|(list, names)| repeated(names).map(|name| format!("{list}: the name {name:?} is not unique")))
            .or_else(|| {
                let missing = |name: &&String| !inputs.contains(&name.as_str());
                let input = self.ports.iter().filter_map(|port| port.input.as_ref()).find(missing)?;
                Some(format!("a port names the input {input:?}, which does not exist"))
            })
            .or_else(|| self.parameters.iter().find_map(Parameter::fault))
    }
}

impl Parameter {
    fn fault(&self) -> Option<String> {
        let Self { name, value, lower, upper, limit, .. } = self;
        if !value.is_finite() {
            return Some(format!("parameter {name:?}: the value {value} is not finite"));
        }
        if self.bounded(*value) != *value {
            let (lower, upper) = (lower.unwrap_or(f64::NEG_INFINITY), upper.unwrap_or(f64::INFINITY));
            return Some(format!("parameter {name:?}: {value} is not within {lower} to {upper}"));
        }
        let limit = limit.filter(|limit| !(limit.is_finite() && *limit > 0.0))?;
        Some(format!("parameter {name:?}: the limit {limit} is not positive"))
    }
}

/// Returns a name that is empty or given twice.
fn repeated(names: &[&str]) -> Option<String> {
    let again = |(at, name): &(usize, &&str)| name.is_empty() || names[..*at].contains(name);
    names.iter().enumerate().find(again).map(|(_, name)| (*name).to_string())
}
