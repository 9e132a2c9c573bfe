use std::collections::BTreeMap;

use plid_simulator::PortVariables;
use serde::{Deserialize, Serialize};

/// The engineer's own simulator: a program (docs/simulator-protocol.md) or an FMU.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SimulatorConfig {
    /// The program and its arguments. It is started in the folder of the case.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub command: Vec<String>,
    /// The file of the FMU, relative to the case.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fmu: Option<String>,
    /// For an FMU: the parameters that may be wrong.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub parameters: Vec<String>,
    /// For an FMU: the places that take a force.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub port: Vec<PortVariables>,
    /// For an FMU: number of steps per sample. If absent, the number follows from the FMU's own step size if there are
    /// ports, and is 1 without ports.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub steps_per_sample: Option<usize>,
    /// Time in s within which the simulator must answer one request.
    #[serde(default = "patience")]
    pub patience_s: f64,
    /// Expected errors of the simulator's parameters, by name and in their units, as two standard deviations. Errors
    /// of this size are not named as causes.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub limits: BTreeMap<String, f64>,
}

/// The data that a prediction needs, in addition to the description, to start an FMU again.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FmuSource {
    /// The file, relative to the case.
    pub file: String,
    /// The places that take a force.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub ports: Vec<PortVariables>,
}

fn patience() -> f64 {
    60.0
}

impl Default for SimulatorConfig {
    /// Returns a configuration with neither a program nor an FMU.
    fn default() -> Self {
        Self {
            command: Vec::new(),
            fmu: None,
            parameters: Vec::new(),
            port: Vec::new(),
            steps_per_sample: None,
            patience_s: patience(),
            limits: BTreeMap::new(),
        }
    }
}

impl SimulatorConfig {
    /// Returns the source of the FMU, if the simulator is one.
    pub fn source(&self) -> Option<FmuSource> {
        Some(FmuSource { file: self.fmu.clone()?, ports: self.port.clone() })
    }

    /// Returns the invalid values, as key and reason.
    pub(super) fn problems(&self, has_sim: bool) -> Vec<(&'static str, String)> {
        let mut problems = Vec::new();
        if has_sim {
            problems.push(("simulator", "a case has either `sim` or `[simulator]`".to_string()));
        }
        match (&self.fmu, self.command.is_empty()) {
            (Some(_), false) => {
                problems.push(("fmu", "a simulator has either `command` or `fmu`".to_string()));
            }
            (Some(file), true) if file.is_empty() => problems.push(("fmu", "it is empty: give a file".to_string())),
            (None, _) if self.command.first().is_none_or(String::is_empty) => {
                let message = "it is empty: give a program and its arguments, or an FMU with `fmu`";
                problems.push(("command", message.to_string()));
            }
            _ => {}
        }
        problems.extend(self.of_fmu());
        if !(self.patience_s.is_finite() && self.patience_s > 0.0) {
            problems.push(("patience_s", format!("{} is not positive", self.patience_s)));
        }
        if let Some((name, limit)) = self.limits.iter().find(|(_, limit)| !(limit.is_finite() && **limit > 0.0)) {
            problems.push(("limits", format!("{name}: {limit} is not positive")));
        }
        problems
    }

    /// Returns the invalid values of the keys that only an FMU has.
    fn of_fmu(&self) -> Vec<(&'static str, String)> {
        let given = [
            ("parameters", !self.parameters.is_empty()),
            ("port", !self.port.is_empty()),
            ("steps_per_sample", self.steps_per_sample.is_some()),
        ];
        let mut problems = Vec::new();
        if self.fmu.is_none()
            && let Some((key, _)) = given.iter().find(|(_, given)| *given)
        {
            problems.push((*key, "only an `fmu` has it: a program describes itself".to_string()));
        }
        if self.steps_per_sample == Some(0) {
            problems.push(("steps_per_sample", "a sample has at least one step".to_string()));
        }
        problems
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn faults(json: serde_json::Value) -> Vec<&'static str> {
        let config: SimulatorConfig = serde_json::from_value(json).unwrap();
        config.problems(false).into_iter().map(|(key, _)| key).collect()
    }

    #[test]
    fn a_simulator_is_a_program_or_an_fmu() {
        let none: [&str; 0] = [];
        assert_eq!(faults(json!({ "command": ["sim"] })), none);
        let port = json!({ "name": "p", "force": "f", "displacement": "x", "velocity": "v" });
        let fmu = json!({ "fmu": "a.fmu", "parameters": ["mass"], "steps_per_sample": 4, "port": [port] });
        assert_eq!(faults(fmu), none);
        assert_eq!(faults(json!({ "patience_s": 1.0 })), ["command"]);
        assert_eq!(faults(json!({ "command": ["sim"], "fmu": "a.fmu" })), ["fmu"]);
        assert_eq!(faults(json!({ "fmu": "" })), ["fmu"]);
        assert_eq!(faults(json!({ "command": ["sim"], "parameters": ["mass"] })), ["parameters"]);
        assert_eq!(faults(json!({ "fmu": "a.fmu", "steps_per_sample": 0 })), ["steps_per_sample"]);
    }
}
