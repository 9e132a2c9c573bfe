//! A damper that the simulation lacks: f = -c v at the port of one input.

use serde::{Deserialize, Serialize};

use crate::config::positive;
use crate::effects::law::{Law, Limits, Load};
use crate::effects::place::Input;
use crate::error::TestbedError;

/// f = -c v.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AddedDamping {
    /// The input at whose port it is.
    pub at: Input,
    /// c, V s/V; positive.
    pub damping_s: f64,
}

impl Law for AddedDamping {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("damping_s", self.damping_s)
    }

    fn load(&self) -> Option<Load> {
        Some(Load { port: self.at.0, damping: self.damping_s, ..Load::default() })
    }

    fn strengthen(&mut self, factor: f64) {
        self.damping_s *= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.damping_s]
    }
}
