//! A joint that hardens or softens: f = -k d^3 at the strut of one input.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::{finite, positive};
use crate::effects::chain::{Chain, Site};
use crate::effects::family::{Halves, Shape};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Input;
use crate::effects::written::{self, Laws};
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;

/// f = -k d^3.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CubicStiffness {
    /// The input at whose strut it acts.
    pub at: Input,
    /// k, 1/V^2; positive hardens, negative softens.
    pub stiffness_per_v2: f64,
    /// The curve.
    #[serde(default, with = "written")]
    pub law: CubicLaw,
    /// The scale s of the laws other than the cubic one, V.
    #[serde(default = "one_volt")]
    pub scale_v: f64,
}

/// Curves of a hardening joint.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum CubicLaw {
    /// -k d^3
    #[default]
    Cubic,
    /// -k s^3 |d / s|^p with the sign of d
    Power {
        /// p; positive.
        exponent: f64,
    },
    /// -k d^3 / (1 + (d / (b s))^2): cubic for a small d, and straight for a large one
    Straightening {
        /// b; positive.
        bend: f64,
    },
}

impl Laws for CubicLaw {
    /// Rounded surfaces in contact have Hertz's exponent of 3/2, and rough ones have larger exponents, up to two.
    /// Beyond the cubic of a joint that stretches lies the next odd power of a series. A joint becomes straight where
    /// its surfaces are in full contact: at a part of the usual motion (b s is `bend` times its RMS in drawn cases),
    /// or only at its peaks. With p = 3, or with a large b, both laws are the cubic.
    const SHAPES: &'static [Shape] = &[
        Shape {
            law: "power",
            number: "exponent",
            fixed: 2.5,
            ranges: Halves { development: &[[2.3, 2.7]], reported: &[[1.5, 2.0], [3.5, 5.0]] },
        },
        Shape {
            law: "straightening",
            number: "bend",
            fixed: 1.0,
            ranges: Halves { development: &[[0.7, 1.4]], reported: &[[0.3, 0.55], [1.8, 2.5]] },
        },
    ];
}

fn one_volt() -> f64 {
    1.0
}

impl Law for CubicStiffness {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        finite("stiffness_per_v2", self.stiffness_per_v2)?;
        positive("scale_v", self.scale_v)?;
        match self.law {
            CubicLaw::Cubic => Ok(()),
            CubicLaw::Power { exponent } => positive("law.exponent", exponent),
            CubicLaw::Straightening { bend } => positive("law.bend", bend),
        }
    }

    fn install(&self, site: Site, chain: &mut Chain) {
        let (k, s, law) = (self.stiffness_per_v2, self.scale_v, self.law);
        chain.force_at(&site.truss.ports[self.at.0], move |d, _v| match law {
            CubicLaw::Cubic => -k * d.powi(3),
            CubicLaw::Power { exponent } => -k * s.powi(3) * (d / s).abs().powf(exponent) * d.signum(),
            CubicLaw::Straightening { bend } => -k * d.powi(3) / (1.0 + (d / (bend * s)).powi(2)),
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
    const SHAPES: &'static [Shape] = CubicLaw::SHAPES;
    const IMPERFECTION: bool = true;

    fn start(draw: &mut Draw<'_>) -> Value {
        let d = draw.level.displacement;
        json!({ "stiffness_per_v2": draw.sign * 0.01 / (d * d), "scale_v": d })
    }
}
