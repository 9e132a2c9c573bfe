//! An actuator that does not respond to small voltages: u' = sign(u) max(|u| - delta, 0).

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::positive;
use crate::effects::chain::{Chain, Site};
use crate::effects::family::Shape;
use crate::effects::law::{Law, Limits};
use crate::effects::place::Input;
use crate::effects::shapes::Gap;
use crate::effects::written::{self, Laws};
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;

/// u' = sign(u) max(|u| - delta, 0).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActuatorDeadZone {
    /// The input.
    pub at: Input,
    /// delta, V; positive.
    pub width_v: f64,
    /// The curve.
    #[serde(default, with = "written")]
    pub law: Gap,
}

impl Law for ActuatorDeadZone {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("width_v", self.width_v)?;
        self.law.check()
    }

    fn install(&self, _site: Site, chain: &mut Chain) {
        let (width, law) = (self.width_v, self.law);
        chain.change_inputs(vec![self.at.0], move |u| law.beyond(u, width));
    }

    fn strengthen(&mut self, factor: f64) {
        self.width_v *= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.width_v]
    }

    fn own_equation(&self) -> bool {
        self.law == Gap::Sharp
    }
}

impl Described for ActuatorDeadZone {
    const FAMILY: Family = Family::NonlinearActuator;
    const AT: At = At::Input;
    const ON: &'static [On] = &[On::Structure, On::Command];
    const PARAMETERS: &'static [&'static str] = &["delta"];
    const NEAR_MISSES: &'static [&'static str] = &["rounded", "asymmetric"];
    const SHAPES: &'static [Shape] = Gap::SHAPES;
    const IMPERFECTION: bool = true;

    fn start(_draw: &mut Draw<'_>) -> Value {
        json!({ "width_v": 0.1 })
    }
}
