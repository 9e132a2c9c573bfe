//! A joint that is stiffer one way than the other: f = -k d^2.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::finite;
use crate::effects::chain::{Chain, Site};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Input;
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;

/// f = -k d^2.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct QuadraticStiffness {
    /// The input whose strut it is.
    pub at: Input,
    /// k, 1/V; either sign.
    pub stiffness_per_v: f64,
    /// The curve.
    #[serde(default)]
    pub law: QuadraticLaw,
}

/// Curves of a joint that is stiffer one way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum QuadraticLaw {
    /// -k d^2
    #[default]
    Quadratic,
    /// -k d^2 where d is positive, and zero elsewhere
    OneSided,
}

impl Law for QuadraticStiffness {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        finite("stiffness_per_v", self.stiffness_per_v)
    }

    fn install(&self, site: Site, chain: &mut Chain) {
        let (k, law) = (self.stiffness_per_v, self.law);
        chain.force_at(&site.truss.ports[self.at.0], move |d, _v| match law {
            QuadraticLaw::Quadratic => -k * d * d,
            QuadraticLaw::OneSided => -k * d.max(0.0).powi(2),
        });
    }

    fn strengthen(&mut self, factor: f64) {
        self.stiffness_per_v *= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.stiffness_per_v]
    }

    fn own_equation(&self) -> bool {
        self.law == QuadraticLaw::Quadratic
    }
}

impl Described for QuadraticStiffness {
    const FAMILY: Family = Family::NonlinearStructure;
    const AT: At = At::Port;
    const ON: &'static [On] = &[On::Structure];
    const PARAMETERS: &'static [&'static str] = &["k"];
    const NEAR_MISSES: &'static [&'static str] = &["one-sided"];
    const IMPERFECTION: bool = true;

    fn start(draw: &mut Draw<'_>) -> Value {
        json!({ "stiffness_per_v": draw.sign * 0.01 / draw.level.displacement })
    }
}
