//! A spring that the simulation lacks: f = -k d at the port of one input.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::positive;
use crate::effects::law::{Law, Limits, Load};
use crate::effects::place::Input;
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;

/// f = -k d.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AddedStiffness {
    /// The input at whose port it acts.
    pub at: Input,
    /// k, V/V; positive.
    pub stiffness: f64,
}

impl Law for AddedStiffness {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("stiffness", self.stiffness)
    }

    fn load(&self) -> Option<Load> {
        Some(Load { port: self.at.0, stiffness: self.stiffness, ..Load::default() })
    }

    fn strengthen(&mut self, factor: f64) {
        self.stiffness *= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.stiffness]
    }
}

impl Described for AddedStiffness {
    const FAMILY: Family = Family::LinearStructure;
    const AT: At = At::Port;
    const ON: &'static [On] = &[On::Position];
    const PARAMETERS: &'static [&'static str] = &["k"];

    fn start(draw: &mut Draw<'_>) -> Value {
        let own = draw.axis();
        // If the axis has no spring, the added one gives an angular frequency of 1 rad/s.
        json!({ "stiffness": if own.stiffness > 0.0 { 0.1 * own.stiffness } else { own.inertia } })
    }
}
