//! A slower actuator: its pole moves.

use serde::{Deserialize, Serialize};

use crate::ACTUATOR_POLE_HZ;
use crate::config::positive;
use crate::effects::law::{Law, Limits, Plant};
use crate::effects::place::Input;
use crate::error::TestbedError;

/// The actuator's existing pole moves to fp; its gain at rest stays 1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActuatorLag {
    /// The input.
    pub at: Input,
    /// fp, Hz; positive.
    pub pole_hz: f64,
    /// Where the pole was, Hz: the strength counts from there.
    #[serde(default = "usual_pole_hz", skip_serializing_if = "is_usual")]
    pub from_hz: f64,
}

fn usual_pole_hz() -> f64 {
    ACTUATOR_POLE_HZ
}

fn is_usual(pole_hz: &f64) -> bool {
    *pole_hz == ACTUATOR_POLE_HZ
}

impl Law for ActuatorLag {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("pole_hz", self.pole_hz)?;
        positive("from_hz", self.from_hz)
    }

    fn alter(&self, plant: &mut Plant) {
        plant.poles_hz[self.at.0] = self.pole_hz;
    }

    fn strengthen(&mut self, factor: f64) {
        // By the ratio of the two poles, which stays positive.
        self.pole_hz = self.from_hz * (self.pole_hz / self.from_hz).powf(factor);
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.pole_hz]
    }
}
