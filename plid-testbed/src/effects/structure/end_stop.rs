//! Stops on both sides of an axis, at the same distance from rest.

use std::f64::consts::TAU;
use std::ops::Range;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::{not_negative, positive};
use crate::effects::chain::{Chain, Site};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Input;
use crate::effects::shapes::stop;
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;

/// x = |d| - g, f = -sign(d) max(k x + c dx/dt, 0) where x > 0, else 0.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EndStop {
    /// The input at whose port the stops are.
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
        // The strength is set by the position of the stops, because a stop that is never reached does nothing.
        self.gap_v /= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.stiffness, self.damping_s, self.gap_v]
    }
}

/// Frequency over the sample rate, and damping ratio, with which an axis would bounce on a stop.
const BOUNCE: Range<f64> = 0.03..0.1;
const BOUNCE_DAMPING: Range<f64> = 0.1..0.4;

/// Returns the keys of a stop on one side (+1 or -1), which begins at a displacement that is seldom reached. The
/// search for the strength moves it nearer.
pub(super) fn start_at(draw: &mut Draw<'_>, side: f64) -> Value {
    let inertia = draw.axis().inertia;
    // The angular frequency at which the axis would bounce on the stop, rad/s.
    let w = TAU * draw.within(BOUNCE) * draw.truss.sample_rate_hz;
    let damping = 2.0 * draw.within(BOUNCE_DAMPING) * w * inertia;
    json!({ "stiffness": w * w * inertia, "damping_s": damping, "gap_v": side * 1.5 * draw.level.displacement })
}

impl Described for EndStop {
    const FAMILY: Family = Family::NonlinearStructure;
    const AT: At = At::Port;
    const ON: &'static [On] = &[On::Position];
    const PARAMETERS: &'static [&'static str] = &["k", "c", "g"];

    fn start(draw: &mut Draw<'_>) -> Value {
        start_at(draw, 1.0)
    }
}
