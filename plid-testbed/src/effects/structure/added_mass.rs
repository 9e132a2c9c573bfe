//! A payload that the simulation lacks: f = -m dv/dt at the port of one input.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::positive;
use crate::effects::law::{Law, Limits, Load};
use crate::effects::place::Input;
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;

/// f = -m dv/dt.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AddedMass {
    /// The input at whose port it acts.
    pub at: Input,
    /// m, V s^2/V; positive.
    pub mass_s2: f64,
}

impl Law for AddedMass {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("mass_s2", self.mass_s2)
    }

    fn load(&self) -> Option<Load> {
        Some(Load { port: self.at.0, mass: self.mass_s2, ..Load::default() })
    }

    fn strengthen(&mut self, factor: f64) {
        self.mass_s2 *= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.mass_s2]
    }
}

impl Described for AddedMass {
    const FAMILY: Family = Family::LinearStructure;
    const AT: At = At::Port;
    const ON: &'static [On] = &[On::Axis];
    const PARAMETERS: &'static [&'static str] = &["m"];

    fn start(draw: &mut Draw<'_>) -> Value {
        json!({ "mass_s2": 0.1 * draw.axis().inertia })
    }
}
