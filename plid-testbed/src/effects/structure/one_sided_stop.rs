//! A stop on one side of an axis.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::end_stop::start_at;
use crate::config::{finite, not_negative, positive};
use crate::effects::chain::{Chain, Site};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Input;
use crate::effects::shapes::stop;
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;

/// x = s d - |g| with s = sign(g), f = -s max(k x + c dx/dt, 0) where x > 0, else 0.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OneSidedStop {
    /// The input at whose port the stop is.
    pub at: Input,
    /// k, V/V; positive.
    pub stiffness: f64,
    /// c, V s/V; zero or more.
    pub damping_s: f64,
    /// g, V; not zero. Its sign gives the side.
    pub gap_v: f64,
}

impl Law for OneSidedStop {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("stiffness", self.stiffness)?;
        not_negative("damping_s", self.damping_s)?;
        finite("gap_v", self.gap_v)?;
        positive("|gap_v|", self.gap_v.abs())
    }

    fn install(&self, site: Site, chain: &mut Chain) {
        let (k, c, g, side) = (self.stiffness, self.damping_s, self.gap_v.abs(), self.gap_v.signum());
        chain.force_at(&site.truss.ports[self.at.0], move |d, v| -side * stop(k, c, side * d - g, side * v));
    }

    fn strengthen(&mut self, factor: f64) {
        self.gap_v /= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.stiffness, self.damping_s, self.gap_v]
    }
}

impl Described for OneSidedStop {
    const FAMILY: Family = Family::NonlinearStructure;
    const AT: At = At::Port;
    const ON: &'static [On] = &[On::Position];
    const PARAMETERS: &'static [&'static str] = &["k", "c", "s"];

    fn start(draw: &mut Draw<'_>) -> Value {
        start_at(draw, draw.sign)
    }
}
