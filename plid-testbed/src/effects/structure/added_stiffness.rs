//! A spring that the simulation lacks: f = -k d at the port of one input.

use serde::{Deserialize, Serialize};

use crate::config::positive;
use crate::effects::law::{Law, Limits, Load};
use crate::effects::place::Input;
use crate::error::TestbedError;

/// f = -k d.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AddedStiffness {
    /// The input at whose port it is.
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
