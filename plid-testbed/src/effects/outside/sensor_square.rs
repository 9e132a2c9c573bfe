//! A sensor with a quadratic characteristic: y' = y + a y^2.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::finite;
use crate::effects::chain::{Chain, Site};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Output;
use crate::effects::{At, Described, Draw, Family, Half, On};
use crate::error::TestbedError;

/// y' = y + a y^2.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorSquare {
    /// The output.
    pub at: Output,
    /// a, 1/V; either sign.
    pub square_per_v: f64,
}

impl Law for SensorSquare {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        finite("square_per_v", self.square_per_v)
    }

    fn install(&self, _site: Site, chain: &mut Chain) {
        let a = self.square_per_v;
        chain.change_output(self.at.0, move |y, _t| y + a * y * y);
    }

    fn strengthen(&mut self, factor: f64) {
        self.square_per_v *= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.square_per_v]
    }
}

impl Described for SensorSquare {
    const FAMILY: Family = Family::Outside(Half::Development);
    const AT: At = At::Output;
    const ON: &'static [On] = &[On::Structure, On::Sensor];
    const IMPERFECTION: bool = true;

    fn start(draw: &mut Draw<'_>) -> Value {
        json!({ "square_per_v": draw.sign * 0.1 / draw.level.output })
    }
}
