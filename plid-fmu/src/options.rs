use std::str::FromStr;

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
    pub ports: Vec<ChosenPort>,
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

/// A place of an FMU that shows its motion and takes a force. As text it is `NAME=FORCE,DISPLACEMENT,VELOCITY`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChosenPort {
    /// Its name.
    pub name: String,
    /// The input that takes the force.
    pub force: String,
    /// The variable that shows the displacement.
    pub displacement: String,
    /// The variable that shows the velocity.
    pub velocity: String,
}

impl FromStr for ChosenPort {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text.split_once('=').map(|(name, rest)| (name, split(rest)));
        match parts {
            Some((name, parts))
                if !name.is_empty() && parts.len() == 3 && parts.iter().all(|part| !part.is_empty()) =>
            {
                let [force, displacement, velocity] = [0, 1, 2].map(|k: usize| parts[k].to_string());
                Ok(Self { name: name.into(), force, displacement, velocity })
            }
            _ => Err(format!("{text:?} is not NAME=FORCE,DISPLACEMENT,VELOCITY")),
        }
    }
}

/// Splits at commas. Those within brackets belong to names, such as `x[1,2]`.
fn split(text: &str) -> Vec<&str> {
    let mut depth = 0;
    let at_comma = |c: char| {
        depth += i32::from(matches!(c, '[' | '(')) - i32::from(matches!(c, ']' | ')'));
        depth == 0 && c == ','
    };
    text.split(at_comma).map(str::trim).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_port_is_read_from_text() {
        let port: ChosenPort = "joint=u[1,2], x[1,2],der(x[1,2])".parse().unwrap();
        let parts = [&port.name, &port.force, &port.displacement, &port.velocity];
        assert_eq!(parts, ["joint", "u[1,2]", "x[1,2]", "der(x[1,2])"]);
        for wrong in ["joint", "joint=f,x", "=f,x,v", "joint=f,,v", "joint=f,x,v,a"] {
            assert!(wrong.parse::<ChosenPort>().unwrap_err().contains("NAME=FORCE"), "{wrong}");
        }
    }
}
