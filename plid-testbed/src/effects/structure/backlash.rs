//! Free play in a transmission: within a gap, the spring of a joint, which the simulation contains, does not act.

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

/// f = k d where |d| < g, k g sign(d) beyond: the force that cancels the joint's own spring k.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Backlash {
    /// The input at whose joint it acts.
    pub at: Input,
    /// k, V/V; positive, the joint's own stiffness.
    pub stiffness: f64,
    /// g, V; positive.
    pub gap_v: f64,
    /// The curve of the remaining spring force.
    #[serde(default, with = "written")]
    pub law: Gap,
}

impl Law for Backlash {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("stiffness", self.stiffness)?;
        positive("gap_v", self.gap_v)?;
        self.law.check()
    }

    fn install(&self, site: Site, chain: &mut Chain) {
        let (k, g, law) = (self.stiffness, self.gap_v, self.law);
        chain.force_at(&site.truss.ports[self.at.0], move |d, _v| k * (d - law.beyond(d, g)));
    }

    fn strengthen(&mut self, factor: f64) {
        self.gap_v *= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.stiffness, self.gap_v]
    }

    fn own_equation(&self) -> bool {
        self.law == Gap::Sharp
    }
}

impl Described for Backlash {
    const FAMILY: Family = Family::NonlinearStructure;
    const AT: At = At::Port;
    const ON: &'static [On] = &[On::Joint];
    const PARAMETERS: &'static [&'static str] = &["k", "g"];
    const NEAR_MISSES: &'static [&'static str] = &["rounded"];
    const SHAPES: &'static [Shape] = Gap::SHAPES;

    fn start(draw: &mut Draw<'_>) -> Value {
        json!({ "stiffness": draw.axis().stiffness, "gap_v": 0.1 * draw.level.displacement })
    }
}
