//! A joint that is stiffer in one direction than in the other: f = -k d^2.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::{finite, positive};
use crate::effects::chain::{Chain, Site};
use crate::effects::family::{Halves, Shape};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Input;
use crate::effects::shapes::signed_power;
use crate::effects::written::{self, Laws};
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;

/// f = -k d^2.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct QuadraticStiffness {
    /// The input at whose strut it acts.
    pub at: Input,
    /// k, 1/V; either sign.
    pub stiffness_per_v: f64,
    /// The curve.
    #[serde(default, with = "written")]
    pub law: QuadraticLaw,
}

/// Curves of a joint that is stiffer in one direction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum QuadraticLaw {
    /// -k d^2
    #[default]
    Quadratic,
    /// -k |d|^p (with d in V) where d is positive, and w times this force elsewhere
    OneSided {
        /// p; positive.
        exponent: f64,
        /// w; either sign.
        other_side: f64,
    },
}

impl Laws for QuadraticLaw {
    /// Contact on one side follows Hertz's exponent of 3/2 between round surfaces, and larger exponents where the
    /// area of contact grows faster, as for rough surfaces or a seal. The other side is seldom entirely free: it has
    /// a part of the curvature, or some curvature of the opposite sign where a preload is released. With p = 2 and w
    /// = 1, the law is the parabola.
    const SHAPES: &'static [Shape] = &[
        Shape {
            law: "one-sided",
            number: "exponent",
            fixed: 2.0,
            ranges: Halves { development: &[[1.85, 2.15]], reported: &[[1.4, 1.7], [2.4, 3.0]] },
        },
        Shape {
            law: "one-sided",
            number: "other_side",
            fixed: 0.0,
            ranges: Halves { development: &[[-0.05, 0.25]], reported: &[[-0.5, -0.15], [0.35, 0.6]] },
        },
    ];
}

impl Law for QuadraticStiffness {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        finite("stiffness_per_v", self.stiffness_per_v)?;
        match self.law {
            QuadraticLaw::Quadratic => Ok(()),
            QuadraticLaw::OneSided { exponent, other_side } => {
                positive("law.exponent", exponent)?;
                finite("law.other_side", other_side)
            }
        }
    }

    fn install(&self, site: Site, chain: &mut Chain) {
        let (k, law) = (self.stiffness_per_v, self.law);
        chain.force_at(&site.truss.ports[self.at.0], move |d, _v| match law {
            QuadraticLaw::Quadratic => -k * d * d,
            QuadraticLaw::OneSided { exponent, other_side } => {
                let share = if d > 0.0 { 1.0 } else { other_side };
                -k * share * (d.abs() * signed_power(d.abs(), 1.0, exponent - 1.0))
            }
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
    const SHAPES: &'static [Shape] = QuadraticLaw::SHAPES;
    const IMPERFECTION: bool = true;

    fn start(draw: &mut Draw<'_>) -> Value {
        json!({ "stiffness_per_v": draw.sign * 0.01 / draw.level.displacement })
    }
}
