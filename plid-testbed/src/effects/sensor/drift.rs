//! A sensor whose zero moves: y' = y + s t.

use serde::{Deserialize, Serialize};

use crate::config::finite;
use crate::effects::chain::{Chain, Site};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Output;
use crate::effects::shapes::Course;
use crate::error::TestbedError;

/// y' = y + s t.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorDrift {
    /// The output.
    pub at: Output,
    /// s, V/s; either sign.
    pub rate_v_per_s: f64,
    /// Its course in time.
    #[serde(default)]
    pub law: Course,
}

impl Law for SensorDrift {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        finite("rate_v_per_s", self.rate_v_per_s)
    }

    fn install(&self, _site: Site, chain: &mut Chain) {
        let (rate, law) = (self.rate_v_per_s, self.law);
        chain.change_output(self.at.0, move |y, t| y + rate * law.at(t));
    }

    fn strengthen(&mut self, factor: f64) {
        self.rate_v_per_s *= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.rate_v_per_s]
    }

    fn own_equation(&self) -> bool {
        self.law == Course::Linear
    }
}
