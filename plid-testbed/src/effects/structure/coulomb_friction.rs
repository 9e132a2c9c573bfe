//! Dry friction at the strut of one input: f = -F tanh(v / v0).

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::{not_negative, positive};
use crate::effects::chain::{Chain, Site};
use crate::effects::family::{Halves, Shape};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Input;
use crate::effects::shapes::signed_power;
use crate::effects::written::{self, Laws};
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;

/// f = -F tanh(v / v0).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CoulombFriction {
    /// The input at whose strut it acts.
    pub at: Input,
    /// F, V; positive.
    pub friction_v: f64,
    /// v0, V/s; positive.
    pub transition_v_per_s: f64,
    /// The curve.
    #[serde(default, with = "written")]
    pub law: FrictionLaw,
}

/// Curves of dry friction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum FrictionLaw {
    /// -F tanh(v / v0)
    #[default]
    Tanh,
    /// -F v / (|v|^2q + v0^2q)^(1 / 2q)
    Root {
        /// q; positive.
        knee: f64,
    },
    /// -F (1 + e exp(-(v / (w v0))^2)) tanh(v / v0): larger at low speed
    Stribeck {
        /// e; zero or more.
        excess: f64,
        /// w; positive.
        speed: f64,
    },
}

impl Laws for FrictionLaw {
    /// Between rest and sliding, a contact with many points yields gradually (a small knee q), and one with few
    /// points almost at once. As q grows, the law tends to a ramp with a corner. From q = 1.25 to 1.4, it differs
    /// from the hyperbolic tangent by less than 3 % of F, as a test of the rounded clip shows, which is the same
    /// curve; nothing is drawn there. Friction at rest exceeds friction during sliding by some tenths between dry
    /// metals, and by more where a film of oil builds up. The film builds up at a speed of a few times the transition
    /// speed, or well above it. Without the excess, the second law is the vocabulary's.
    const SHAPES: &'static [Shape] = &[
        Shape {
            law: "root",
            number: "knee",
            fixed: 1.0,
            ranges: Halves { development: &[[0.85, 1.05]], reported: &[[0.5, 0.7], [1.6, 2.5]] },
        },
        Shape {
            law: "stribeck",
            number: "excess",
            fixed: 0.5,
            ranges: Halves { development: &[[0.35, 0.7]], reported: &[[0.15, 0.25], [0.9, 1.5]] },
        },
        Shape {
            law: "stribeck",
            number: "speed",
            fixed: 5.0,
            ranges: Halves { development: &[[3.5, 6.5]], reported: &[[1.5, 2.5], [8.0, 15.0]] },
        },
    ];
}

impl Law for CoulombFriction {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("friction_v", self.friction_v)?;
        positive("transition_v_per_s", self.transition_v_per_s)?;
        match self.law {
            FrictionLaw::Tanh => Ok(()),
            FrictionLaw::Root { knee } => positive("law.knee", knee),
            FrictionLaw::Stribeck { excess, speed } => {
                not_negative("law.excess", excess)?;
                positive("law.speed", speed)
            }
        }
    }

    fn install(&self, site: Site, chain: &mut Chain) {
        let (f, v0, law) = (self.friction_v, self.transition_v_per_s, self.law);
        chain.force_at(&site.truss.ports[self.at.0], move |_d, v| match law {
            FrictionLaw::Tanh => -f * (v / v0).tanh(),
            FrictionLaw::Root { knee } => {
                let v = signed_power(v, v0, knee);
                signed_power(-f * v / v.hypot(v0), f, 1.0 / knee)
            }
            FrictionLaw::Stribeck { excess, speed } => {
                -f * (1.0 + excess * (-(v / (speed * v0)).powi(2)).exp()) * (v / v0).tanh()
            }
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
    const SHAPES: &'static [Shape] = FrictionLaw::SHAPES;
    const IMPERFECTION: bool = true;

    fn start(draw: &mut Draw<'_>) -> Value {
        json!({ "friction_v": 0.01, "transition_v_per_s": draw.within(0.05..0.15) * draw.level.velocity })
    }
}
