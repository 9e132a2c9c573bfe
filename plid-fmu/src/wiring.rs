//! The assignment of an FMU's variables to the channels, ports and parameters of a simulator.

use std::path::Path;

use plid_data::nearest;
use plid_simulator::{Description, Input, Output, Parameter, Port, PortVariables};

use crate::description::{ModelDescription, Variable};
use crate::{ChosenParameter, FmuError, Options};

/// The variables of a simulator.
#[derive(Clone)]
pub(crate) struct Wiring {
    pub description: Description,
    /// The variables that are set in each step: inputs, then the forces that are not inputs.
    pub driven: Vec<u32>,
    /// Start values of these variables. A force that is not an input is added to its start value.
    pub base: Vec<f64>,
    /// For each port, the index of its force among these variables.
    pub forces: Vec<usize>,
    pub outputs: Vec<u32>,
    /// Displacement and velocity of each port.
    pub motions: Vec<u32>,
    /// The names of these variables.
    pub motion_names: Vec<String>,
    pub parameters: Vec<u32>,
    /// All variables that can be read, which show whether a reset restores the initial state.
    pub all: Vec<u32>,
    /// Length of a step in s.
    pub step: f64,
}

/// Largest number of names in a message.
const NAMED: usize = 20;

/// The variables of an FMU, and the messages about them.
struct Chooser<'a> {
    file: &'a Path,
    model: &'a ModelDescription,
}

impl Wiring {
    pub fn new(file: &Path, model: &ModelDescription, options: &Options) -> Result<Self, FmuError> {
        let chooser = Chooser { file, model };
        let inputs = chooser.inputs(options)?;
        let outputs = chooser.outputs(options)?;
        let (rate, steps) = chooser.steps(options)?;
        let mut driven = inputs.clone();
        let mut forces = Vec::new();
        let mut motions: Vec<&Variable> = Vec::new();
        let mut ports = Vec::new();
        for port in &options.ports {
            let force = chooser.input(&port.force, "the force of a port")?;
            let at = driven.iter().position(|one| one.reference == force.reference);
            forces.push(at.unwrap_or(driven.len()));
            if at.is_none() {
                driven.push(force);
            }
            let [displacement, velocity] = chooser.motion(port)?;
            motions.extend([displacement, velocity]);
            let input = inputs.iter().any(|one| one.name == force.name).then(|| force.name.clone());
            let (force_unit, displacement_unit) = (force.unit.clone(), displacement.unit.clone());
            ports.push(Port { name: port.name.clone(), input, force_unit, displacement_unit });
        }
        let parameters: Vec<(u32, Parameter)> =
            options.parameters.iter().map(|chosen| chooser.parameter(chosen)).collect::<Result<_, _>>()?;
        let of = |variables: &[&Variable]| variables.iter().map(|one| one.reference).collect::<Vec<u32>>();
        let readable =
            |one: &&Variable| one.is_real() && one.causality != "independent" && one.variability != "constant";
        let description = Description {
            name: model.name.clone(),
            rate_hz: rate,
            inputs: inputs.iter().map(|one| Input { name: one.name.clone(), unit: one.unit.clone() }).collect(),
            outputs: outputs.iter().map(|one| output(one)).collect(),
            ports,
            parameters: parameters.iter().map(|(_, parameter)| parameter.clone()).collect(),
            steps_per_sample: steps,
            states: model.keeps_states,
        };
        description.check().map_err(|error| chooser.setting(error.to_string()))?;
        Ok(Self {
            description,
            base: driven.iter().map(|one| one.start.unwrap_or(0.0)).collect(),
            driven: of(&driven),
            forces,
            outputs: of(&outputs),
            motion_names: motions.iter().map(|one| one.name.clone()).collect(),
            motions: of(&motions),
            parameters: parameters.iter().map(|(reference, _)| *reference).collect(),
            all: of(&model.variables.iter().filter(readable).collect::<Vec<_>>()),
            step: 1.0 / (rate * steps as f64),
        })
    }
}

fn output(variable: &Variable) -> Output {
    Output { name: variable.name.clone(), kind: variable.quantity, unit: variable.unit.clone() }
}

fn is_input(variable: &Variable) -> bool {
    variable.is_real() && variable.causality == "input"
}

fn is_output(variable: &Variable) -> bool {
    variable.is_real() && variable.causality == "output"
}

fn is_parameter(variable: &Variable) -> bool {
    variable.is_real()
        && variable.causality == "parameter"
        && matches!(variable.variability.as_str(), "fixed" | "tunable")
}

fn moves(variable: &Variable) -> bool {
    variable.is_real()
        && matches!(variable.causality.as_str(), "output" | "local")
        && matches!(variable.variability.as_str(), "continuous" | "discrete")
}

impl<'a> Chooser<'a> {
    fn setting(&self, message: String) -> FmuError {
        FmuError::Setting { file: self.file.into(), message }
    }

    /// Returns the variable with a name if it is suitable for a use.
    fn find(&self, name: &str, fit: fn(&Variable) -> bool, wanted: &str) -> Result<&'a Variable, FmuError> {
        let found = self.model.variables.iter().find(|one| one.name == name);
        if let Some(found) = found.filter(|found| fit(found)) {
            return Ok(found);
        }
        let fit_names: Vec<&String> = self.model.variables.iter().filter(|one| fit(one)).map(|one| &one.name).collect();
        let (fault, meant) = match found {
            Some(found) => (format!("it is {}", found.in_words()), String::new()),
            None => {
                let meant = nearest(name, fit_names.iter().copied());
                let meant = meant.map(|name| format!("; did you mean {name:?}?")).unwrap_or_default();
                ("the FMU has none of this name".to_string(), meant)
            }
        };
        let message = format!("{fault}; {wanted} would be {}{meant}", listed(&fit_names));
        Err(FmuError::Variable { file: self.file.into(), variable: name.into(), message })
    }

    fn input(&self, name: &str, wanted: &str) -> Result<&'a Variable, FmuError> {
        self.find(name, is_input, wanted)
    }

    fn inputs(&self, options: &Options) -> Result<Vec<&'a Variable>, FmuError> {
        if let Some(names) = &options.inputs {
            return names.iter().map(|name| self.input(name, "a real input")).collect();
        }
        let all: Vec<&Variable> = self.model.variables.iter().filter(|one| is_input(one)).collect();
        let takes_a_force = |one: &&Variable| options.ports.iter().any(|port| port.force == one.name);
        let plain: Vec<&Variable> = all.iter().copied().filter(|one| !takes_a_force(one)).collect();
        Ok(if plain.is_empty() { all } else { plain })
    }

    fn outputs(&self, options: &Options) -> Result<Vec<&'a Variable>, FmuError> {
        match &options.outputs {
            Some(names) => names.iter().map(|name| self.find(name, is_output, "a real output")).collect(),
            None => Ok(self.model.variables.iter().filter(|one| is_output(one)).collect()),
        }
    }

    fn motion(&self, port: &PortVariables) -> Result<[&'a Variable; 2], FmuError> {
        let find = |name: &str| self.find(name, moves, "a variable that moves");
        Ok([find(&port.displacement)?, find(&port.velocity)?])
    }

    fn parameter(&self, chosen: &ChosenParameter) -> Result<(u32, Parameter), FmuError> {
        let ChosenParameter { name, value, lower, upper, limit, unit } = chosen;
        let found = self.find(name, is_parameter, "a real parameter that is fixed or tunable")?;
        let missing = || FmuError::Variable {
            file: self.file.into(),
            variable: name.clone(),
            message: "it has no start value: give a value".into(),
        };
        let parameter = Parameter {
            name: name.clone(),
            value: value.or(found.start).ok_or_else(missing)?,
            unit: unit.clone().or_else(|| found.unit.clone()),
            lower: lower.or(found.min),
            upper: upper.or(found.max),
            limit: *limit,
        };
        Ok((found.reference, parameter))
    }

    /// Returns the sample rate and the number of steps in a sample.
    fn steps(&self, options: &Options) -> Result<(f64, usize), FmuError> {
        let own = self.model.step_size;
        let rate = match (options.rate_hz, own) {
            (Some(rate), _) => rate,
            (None, Some(step)) => 1.0 / step,
            (None, None) => return Err(self.setting("it does not state a step size: give a sample rate".into())),
        };
        if !(rate.is_finite() && rate > 0.0) {
            return Err(self.setting(format!("the sample rate of {rate} Hz is not positive")));
        }
        let steps = match (options.steps_per_sample, own) {
            (Some(0), _) => return Err(self.setting("a sample has at least one step, not 0".into())),
            (Some(steps), _) => steps,
            // The last step of a sample is not shortened. Instead, all steps are slightly shorter.
            (None, Some(step)) if !options.ports.is_empty() => ((1.0 / (rate * step) - 1e-6).ceil() as usize).max(1),
            (None, _) => 1,
        };
        Ok((rate, steps))
    }
}

/// Returns names in a list.
fn listed(names: &[&String]) -> String {
    let first: Vec<&str> = names.iter().take(NAMED).map(|name| name.as_str()).collect();
    match names.len() - first.len() {
        _ if names.is_empty() => "none".into(),
        0 => first.join(", "),
        more => format!("{} and {more} more", first.join(", ")),
    }
}
