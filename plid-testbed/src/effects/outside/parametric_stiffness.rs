//! Stiffness that varies periodically, such as at twice the frequency of a mode: w^2 -> w^2 (1 + s sin(2 pi f t)).

use std::f64::consts::PI;

use rand::RngExt;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::{finite, positive};
use crate::effects::chain::{Chain, Site, StructureEffect, add_scaled};
use crate::effects::law::{Law, Limits};
use crate::effects::{At, Described, Draw, Family, Half, On};
use crate::error::TestbedError;
use crate::plant::{modal_force, mode_state};

/// w_m^2 -> w_m^2 (1 + s sin(2 pi f t)) for every mode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ParametricStiffness {
    /// s, below 1 in magnitude.
    pub share: f64,
    /// f, Hz; positive.
    pub frequency_hz: f64,
}

struct Pumped {
    share: f64,
    rate: f64,
    modes: Vec<(f64, Vec<f64>)>,
}

impl StructureEffect for Pumped {
    fn add_rate(&self, t_s: f64, x: &[f64], rate: &mut [f64]) {
        let now = self.share * (self.rate * t_s).sin();
        for (m, (own, entry)) in self.modes.iter().enumerate() {
            add_scaled(rate, entry, -own * now * x[mode_state(m)]);
        }
    }
}

impl Law for ParametricStiffness {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        finite("share", self.share)?;
        positive("1 - |share|", 1.0 - self.share.abs())?;
        positive("frequency_hz", self.frequency_hz)
    }

    fn install(&self, site: Site, chain: &mut Chain) {
        let modes = &site.truss.modes;
        let modes = (0..modes.len()).map(|m| (modes[m].angular_frequency(), modal_force(modes, m))).collect();
        chain.structure.push(Box::new(Pumped { share: self.share, rate: 2.0 * PI * self.frequency_hz, modes }));
    }

    fn strengthen(&mut self, factor: f64) {
        self.share *= factor;
    }

    fn place(&self) -> usize {
        0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.share, self.frequency_hz]
    }
}

impl Described for ParametricStiffness {
    const FAMILY: Family = Family::Outside(Half::Development);
    const AT: At = At::Whole;
    const ON: &'static [On] = &[On::Structure];

    fn start(draw: &mut Draw<'_>) -> Value {
        // Twice the frequency of a dominant mode, at which a periodic stiffness has the largest effect.
        let mode = &draw.truss.modes[draw.rng.random_range(draw.dominant.clone())];
        json!({ "share": 1e-3, "frequency_hz": 2.0 * mode.frequency_hz })
    }
}
