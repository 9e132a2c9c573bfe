//! Dry friction at the strut of one input: f = -F tanh(v / v0).

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::positive;
use crate::effects::chain::{Chain, Site};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Input;
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;

/// f = -F tanh(v / v0).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CoulombFriction {
    /// The input whose strut it is.
    pub at: Input,
    /// F, V; positive.
    pub friction_v: f64,
    /// v0, V/s; positive.
    pub transition_v_per_s: f64,
    /// The curve.
    #[serde(default)]
    pub law: FrictionLaw,
}

/// Curves of dry friction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FrictionLaw {
    /// -F tanh(v / v0)
    #[default]
    Tanh,
    /// -F v / sqrt(v^2 + v0^2)
    Root,
    /// -F (1 + exp(-(v / (5 v0))^2) / 2) tanh(v / v0): more while it hardly moves
    Stribeck,
}

impl Law for CoulombFriction {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("friction_v", self.friction_v)?;
        positive("transition_v_per_s", self.transition_v_per_s)
    }

    fn install(&self, site: Site, chain: &mut Chain) {
        let (f, v0, law) = (self.friction_v, self.transition_v_per_s, self.law);
        chain.force_at(&site.truss.ports[self.at.0], move |_d, v| match law {
            FrictionLaw::Tanh => -f * (v / v0).tanh(),
            FrictionLaw::Root => -f * v / v.hypot(v0),
            FrictionLaw::Stribeck => -f * (1.0 + 0.5 * (-(v / (5.0 * v0)).powi(2)).exp()) * (v / v0).tanh(),
        });
    }

    fn strengthen(&mut self, factor: f64) {
        self.friction_v *= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.friction_v, self.transition_v_per_s]
    }

    fn own_equation(&self) -> bool {
        self.law == FrictionLaw::Tanh
    }
}

impl Described for CoulombFriction {
    const FAMILY: Family = Family::NonlinearStructure;
    const AT: At = At::Port;
    const ON: &'static [On] = &[On::Structure, On::Axis];
    const PARAMETERS: &'static [&'static str] = &["F", "v0"];
    const NEAR_MISSES: &'static [&'static str] = &["root", "stribeck"];
    const IMPERFECTION: bool = true;

    fn start(draw: &mut Draw<'_>) -> Value {
        json!({ "friction_v": 0.01, "transition_v_per_s": draw.within(0.05..0.15) * draw.level.velocity })
    }
}
