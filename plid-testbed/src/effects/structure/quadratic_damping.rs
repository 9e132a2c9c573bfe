//! Damping that grows with speed: f = -c |v| v.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::positive;
use crate::effects::chain::{Chain, Site};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Input;
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;

/// f = -c |v| v.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct QuadraticDamping {
    /// The input whose strut it is.
    pub at: Input,
    /// c, s^2/V; positive.
    pub damping_s2_per_v: f64,
    /// The curve.
    #[serde(default)]
    pub law: DampingLaw,
    /// s of the power law, V/s.
    #[serde(default = "one_volt_a_second")]
    pub scale_v_per_s: f64,
}

/// Curves of damping that grows with speed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DampingLaw {
    /// -c |v| v
    #[default]
    Quadratic,
    /// -c s^2 |v / s|^1.7 with the sign of v
    Power,
    /// -c |v| v one way, half of it the other
    Asymmetric,
}

fn one_volt_a_second() -> f64 {
    1.0
}

impl Law for QuadraticDamping {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("damping_s2_per_v", self.damping_s2_per_v)?;
        positive("scale_v_per_s", self.scale_v_per_s)
    }

    fn install(&self, site: Site, chain: &mut Chain) {
        let (c, s, law) = (self.damping_s2_per_v, self.scale_v_per_s, self.law);
        chain.force_at(&site.truss.ports[self.at.0], move |_d, v| match law {
            DampingLaw::Quadratic => -c * v.abs() * v,
            DampingLaw::Power => -c * s * s * (v / s).abs().powf(1.7) * v.signum(),
            DampingLaw::Asymmetric => -c * v.abs() * v * if v < 0.0 { 0.5 } else { 1.0 },
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
    const IMPERFECTION: bool = true;

    fn start(draw: &mut Draw<'_>) -> Value {
        let v = draw.level.velocity;
        json!({ "damping_s2_per_v": 0.01 / (v * v), "scale_v_per_s": v })
    }
}
