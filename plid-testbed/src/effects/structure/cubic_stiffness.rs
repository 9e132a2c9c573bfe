//! A joint that hardens or softens: f = -k d^3 at the strut of one input.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::{finite, positive};
use crate::effects::chain::{Chain, Site};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Input;
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;

/// f = -k d^3.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CubicStiffness {
    /// The input whose strut it is.
    pub at: Input,
    /// k, 1/V^2; positive hardens, negative softens.
    pub stiffness_per_v2: f64,
    /// The curve.
    #[serde(default)]
    pub law: CubicLaw,
    /// s of the laws other than the cubic, V.
    #[serde(default = "one_volt")]
    pub scale_v: f64,
}

/// Curves of a hardening joint.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CubicLaw {
    /// -k d^3
    #[default]
    Cubic,
    /// -k s^3 |d / s|^2.5 with the sign of d
    Power,
    /// -k d^3 / (1 + (d / s)^2): cubic while small, then straight
    Straightening,
}

fn one_volt() -> f64 {
    1.0
}

impl Law for CubicStiffness {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        finite("stiffness_per_v2", self.stiffness_per_v2)?;
        positive("scale_v", self.scale_v)
    }

    fn install(&self, site: Site, chain: &mut Chain) {
        let (k, s, law) = (self.stiffness_per_v2, self.scale_v, self.law);
        chain.force_at(&site.truss.ports[self.at.0], move |d, _v| match law {
            CubicLaw::Cubic => -k * d.powi(3),
            CubicLaw::Power => -k * s.powi(3) * (d / s).abs().powf(2.5) * d.signum(),
            CubicLaw::Straightening => -k * d.powi(3) / (1.0 + (d / s).powi(2)),
        });
    }

    fn strengthen(&mut self, factor: f64) {
        self.stiffness_per_v2 *= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.stiffness_per_v2]
    }

    fn own_equation(&self) -> bool {
        self.law == CubicLaw::Cubic
    }
}

impl Described for CubicStiffness {
    const FAMILY: Family = Family::NonlinearStructure;
    const AT: At = At::Port;
    const ON: &'static [On] = &[On::Structure, On::Joint];
    const PARAMETERS: &'static [&'static str] = &["k"];
    const NEAR_MISSES: &'static [&'static str] = &["power", "straightening"];
    const IMPERFECTION: bool = true;

    fn start(draw: &mut Draw<'_>) -> Value {
        let d = draw.level.displacement;
        json!({ "stiffness_per_v2": draw.sign * 0.01 / (d * d), "scale_v": d })
    }
}
