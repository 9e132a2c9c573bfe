//! An amplifier that saturates: u' = a tanh(u / a).

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::positive;
use crate::effects::chain::{Chain, Site};
use crate::effects::family::Shape;
use crate::effects::law::{Law, Limits};
use crate::effects::place::Input;
use crate::effects::shapes::Limit;
use crate::effects::written::{self, Laws};
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;

/// u' = a tanh(u / a).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActuatorSaturation {
    /// The input.
    pub at: Input,
    /// a, V; positive.
    pub limit_v: f64,
    /// The curve.
    #[serde(default = "tanh", with = "written")]
    pub law: Limit,
}

fn tanh() -> Limit {
    Limit::TANH
}

impl Law for ActuatorSaturation {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("limit_v", self.limit_v)?;
        self.law.check()
    }

    fn install(&self, _site: Site, chain: &mut Chain) {
        let (a, law) = (self.limit_v, self.law);
        chain.change_inputs(vec![self.at.0], move |u| law.of(u, a));
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
        self.law == Limit::TANH
    }
}

impl Described for ActuatorSaturation {
    const FAMILY: Family = Family::NonlinearActuator;
    const AT: At = At::Input;
    const ON: &'static [On] = &[On::Structure, On::Command, On::Reference];
    const PARAMETERS: &'static [&'static str] = &["a"];
    const NEAR_MISSES: &'static [&'static str] = &["clip", "arctangent"];
    const SHAPES: &'static [Shape] = Limit::SHAPES;
    const IMPERFECTION: bool = true;

    fn start(_draw: &mut Draw<'_>) -> Value {
        json!({ "limit_v": 4.0 })
    }
}
