//! A sensor that clips: y' = min(max(y, -a), a). The noise is added afterwards.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::positive;
use crate::effects::chain::{Chain, Site};
use crate::effects::family::Shape;
use crate::effects::law::{Law, Limits};
use crate::effects::place::Output;
use crate::effects::shapes::Limit;
use crate::effects::written::{self, Laws};
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;

/// y' = min(max(y, -a), a).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorSaturation {
    /// The output.
    pub at: Output,
    /// a, V; positive.
    pub limit_v: f64,
    /// The curve.
    #[serde(default = "clip", with = "written")]
    pub law: Limit,
}

fn clip() -> Limit {
    Limit::CLIP
}

impl Law for SensorSaturation {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("limit_v", self.limit_v)?;
        self.law.check()
    }

    fn install(&self, _site: Site, chain: &mut Chain) {
        let (a, law) = (self.limit_v, self.law);
        chain.change_output(self.at.0, move |y, _t| law.of(y, a));
    }

    fn strengthen(&mut self, factor: f64) {
        self.limit_v /= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.limit_v]
    }

    fn own_equation(&self) -> bool {
        self.law == Limit::CLIP
    }
}

impl Described for SensorSaturation {
    const FAMILY: Family = Family::NonlinearSensor;
    const AT: At = At::Output;
    const ON: &'static [On] = &[On::Structure];
    const PARAMETERS: &'static [&'static str] = &["a"];
    const NEAR_MISSES: &'static [&'static str] = &["tanh", "arctangent"];
    const SHAPES: &'static [Shape] = Limit::SHAPES;
    const IMPERFECTION: bool = true;

    fn start(draw: &mut Draw<'_>) -> Value {
        json!({ "limit_v": 2.0 * draw.level.output })
    }
}
