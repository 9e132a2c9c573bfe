//! Damping that grows with speed: f = -c |v| v.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::{not_negative, positive};
use crate::effects::chain::{Chain, Site};
use crate::effects::family::{Halves, Shape};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Input;
use crate::effects::written::{self, Laws};
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;

/// f = -c |v| v.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct QuadraticDamping {
    /// The input at whose strut it acts.
    pub at: Input,
    /// c, s^2/V; positive.
    pub damping_s2_per_v: f64,
    /// The curve.
    #[serde(default, with = "written")]
    pub law: DampingLaw,
    /// s of the power law, V/s.
    #[serde(default = "one_volt_a_second")]
    pub scale_v_per_s: f64,
}

/// Curves of damping that grows with speed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum DampingLaw {
    /// -c |v| v
    #[default]
    Quadratic,
    /// -c s^2 |v / s|^p with the sign of v
    Power {
        /// p; positive.
        exponent: f64,
    },
    /// -c |v| v where v is positive, and w times this force elsewhere
    Asymmetric {
        /// w; zero or more.
        other_way: f64,
    },
}

impl Laws for DampingLaw {
    /// The flows in pipes and gaps lie between creeping flow (p = 1) and flow dominated by inertia (p = 2). Valves
    /// that close with the flow go beyond. Shock absorbers brake several times as much one way as the other; in
    /// development, it is always the same way. With p = 2, or w = 1, both laws are the vocabulary's.
    const SHAPES: &'static [Shape] = &[
        Shape {
            law: "power",
            number: "exponent",
            fixed: 1.7,
            ranges: Halves { development: &[[1.5, 1.8]], reported: &[[1.15, 1.35], [2.3, 3.0]] },
        },
        Shape {
            law: "asymmetric",
            number: "other_way",
            fixed: 0.5,
            ranges: Halves { development: &[[0.4, 0.65]], reported: &[[0.1, 0.3], [1.5, 2.5]] },
        },
    ];
}

fn one_volt_a_second() -> f64 {
    1.0
}

impl Law for QuadraticDamping {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("damping_s2_per_v", self.damping_s2_per_v)?;
        positive("scale_v_per_s", self.scale_v_per_s)?;
        match self.law {
            DampingLaw::Quadratic => Ok(()),
            DampingLaw::Power { exponent } => positive("law.exponent", exponent),
            DampingLaw::Asymmetric { other_way } => not_negative("law.other_way", other_way),
        }
    }

    fn install(&self, site: Site, chain: &mut Chain) {
        let (c, s, law) = (self.damping_s2_per_v, self.scale_v_per_s, self.law);
        chain.force_at(&site.truss.ports[self.at.0], move |_d, v| match law {
            DampingLaw::Quadratic => -c * v.abs() * v,
            DampingLaw::Power { exponent } => -c * s * s * (v / s).abs().powf(exponent) * v.signum(),
            DampingLaw::Asymmetric { other_way } => -c * v.abs() * v * if v < 0.0 { other_way } else { 1.0 },
        });
    }

    fn strengthen(&mut self, factor: f64) {
        self.damping_s2_per_v *= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.damping_s2_per_v]
    }

    fn own_equation(&self) -> bool {
        self.law == DampingLaw::Quadratic
    }
}

impl Described for QuadraticDamping {
    const FAMILY: Family = Family::NonlinearStructure;
    const AT: At = At::Port;
    const ON: &'static [On] = &[On::Structure, On::Axis];
    const PARAMETERS: &'static [&'static str] = &["c"];
    const NEAR_MISSES: &'static [&'static str] = &["power", "asymmetric"];
    const SHAPES: &'static [Shape] = DampingLaw::SHAPES;
    const IMPERFECTION: bool = true;

    fn start(draw: &mut Draw<'_>) -> Value {
        let v = draw.level.velocity;
        json!({ "damping_s2_per_v": 0.01 / (v * v), "scale_v_per_s": v })
    }
}
