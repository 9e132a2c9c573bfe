//! A joint that meets a stop, or leaves one, beyond a gap.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::{finite, positive};
use crate::effects::chain::{Chain, Site};
use crate::effects::family::Shape;
use crate::effects::law::{Law, Limits};
use crate::effects::place::Input;
use crate::effects::shapes::Gap;
use crate::effects::written::{self, Laws};
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;

/// f = -k (d - g) where d > g, -k (d + g) where d < -g, else 0.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Clearance {
    /// The input at whose strut it acts.
    pub at: Input,
    /// k, V/V; negative where stiffness is lost beyond the gap.
    pub stiffness: f64,
    /// g, V; positive.
    pub gap_v: f64,
    /// The curve.
    #[serde(default, with = "written")]
    pub law: Gap,
}

impl Law for Clearance {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        finite("stiffness", self.stiffness)?;
        positive("gap_v", self.gap_v)?;
        self.law.check()
    }

    fn install(&self, site: Site, chain: &mut Chain) {
        let (k, g, law) = (self.stiffness, self.gap_v, self.law);
        chain.force_at(&site.truss.ports[self.at.0], move |d, _v| -k * law.beyond(d, g));
    }

    fn strengthen(&mut self, factor: f64) {
        self.stiffness *= factor;
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

impl Described for Clearance {
    const FAMILY: Family = Family::NonlinearStructure;
    const AT: At = At::Port;
    const ON: &'static [On] = &[On::Structure, On::Joint];
    const PARAMETERS: &'static [&'static str] = &["k", "g"];
    const NEAR_MISSES: &'static [&'static str] = &["rounded", "asymmetric"];
    const SHAPES: &'static [Shape] = Gap::SHAPES;
    const IMPERFECTION: bool = true;

    fn start(draw: &mut Draw<'_>) -> Value {
        json!({ "stiffness": draw.sign * 0.01, "gap_v": draw.within(0.6..1.6) * draw.level.displacement })
    }
}
