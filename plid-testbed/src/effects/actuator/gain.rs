//! An actuator of another gain: u' = g u.

use serde::{Deserialize, Serialize};

use crate::config::finite;
use crate::effects::chain::{Chain, Site};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Input;
use crate::error::TestbedError;

/// u' = g u.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActuatorGain {
    /// The input.
    pub at: Input,
    /// g.
    pub gain: f64,
}

impl Law for ActuatorGain {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        finite("gain", self.gain)
    }

    fn install(&self, _site: Site, chain: &mut Chain) {
        let gain = self.gain;
        chain.change_inputs(vec![self.at.0], move |u| gain * u);
    }

    fn strengthen(&mut self, factor: f64) {
        self.gain = 1.0 + factor * (self.gain - 1.0);
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.gain]
    }
}
