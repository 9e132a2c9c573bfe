//! A sensor whose zero drifts: y' = y + s t.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::finite;
use crate::effects::chain::{Chain, Site};
use crate::effects::family::Shape;
use crate::effects::law::{Law, Limits};
use crate::effects::place::Output;
use crate::effects::shapes::Course;
use crate::effects::written::{self, Laws};
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;

/// y' = y + s t.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorDrift {
    /// The output.
    pub at: Output,
    /// s, V/s; either sign.
    pub rate_v_per_s: f64,
    /// The course of the drift in time.
    #[serde(default, with = "written")]
    pub law: Course,
}

impl Law for SensorDrift {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        finite("rate_v_per_s", self.rate_v_per_s)?;
        self.law.check()
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

impl Described for SensorDrift {
    const FAMILY: Family = Family::AddedBySensor;
    const AT: At = At::Output;
    const ON: &'static [On] = &[On::Structure, On::Sensor];
    const PARAMETERS: &'static [&'static str] = &["s"];
    const NEAR_MISSES: &'static [&'static str] = &["settling"];
    const SHAPES: &'static [Shape] = Course::SHAPES;
    const IMPERFECTION: bool = true;

    fn start(draw: &mut Draw<'_>) -> Value {
        json!({ "rate_v_per_s": draw.sign * 1e-3 })
    }
}
