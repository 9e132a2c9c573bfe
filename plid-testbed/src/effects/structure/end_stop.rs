//! Stops on both sides of an axis, at the same distance from rest.

use serde::{Deserialize, Serialize};

use crate::config::{not_negative, positive};
use crate::effects::chain::{Chain, Site};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Input;
use crate::effects::shapes::stop;
use crate::error::TestbedError;

/// x = |d| - g, f = -sign(d) max(k x + c dx/dt, 0) where x > 0, else 0.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EndStop {
    /// The input at whose port they are.
    pub at: Input,
    /// k, V/V; positive.
    pub stiffness: f64,
    /// c, V s/V; zero or more.
    pub damping_s: f64,
    /// g, V; positive.
    pub gap_v: f64,
}

impl Law for EndStop {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("stiffness", self.stiffness)?;
        not_negative("damping_s", self.damping_s)?;
        positive("gap_v", self.gap_v)
    }

    fn install(&self, site: Site, chain: &mut Chain) {
        let (k, c, g) = (self.stiffness, self.damping_s, self.gap_v);
        chain.force_at(&site.truss.ports[self.at.0], move |d, v| -d.signum() * stop(k, c, d.abs() - g, v * d.signum()));
    }

    fn strengthen(&mut self, factor: f64) {
        // By where they are: a stop that is never reached does nothing.
        self.gap_v /= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.stiffness, self.damping_s, self.gap_v]
    }
}
