//! One mode at another frequency: w -> w (1 + delta), damping ratio and shapes kept.

use serde::{Deserialize, Serialize};

use crate::config::{finite, positive};
use crate::effects::law::{Law, Limits, Plant};
use crate::effects::place::ModeNumber;
use crate::error::TestbedError;

/// w_m -> w_m (1 + delta).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModalFrequency {
    /// The mode.
    pub at: ModeNumber,
    /// delta; above -1.
    pub change: f64,
}

impl Law for ModalFrequency {
    fn check(&self, limits: &Limits) -> Result<(), TestbedError> {
        limits.mode(self.at)?;
        finite("change", self.change)?;
        positive("1 + change", 1.0 + self.change)
    }

    fn alter(&self, plant: &mut Plant) {
        plant.modes[self.at.0].frequency_hz *= 1.0 + self.change;
    }

    fn strengthen(&mut self, factor: f64) {
        self.change *= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.change]
    }
}
