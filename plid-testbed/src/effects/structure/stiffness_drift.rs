//! A slow change of stiffness: w_m^2 -> w_m^2 (1 + r t) for every mode, t since the first record began.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::finite;
use crate::effects::chain::{Chain, Site, StructureEffect, add_scaled};
use crate::effects::family::Shape;
use crate::effects::law::{Law, Limits};
use crate::effects::shapes::Course;
use crate::effects::written::{self, Laws};
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;
use crate::plant::{modal_force, mode_state};

/// w_m^2 -> w_m^2 (1 + r t).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StiffnessDrift {
    /// r, 1/s; either sign.
    pub rate_per_s: f64,
    /// The course of the change in time.
    #[serde(default, with = "written")]
    pub law: Course,
}

/// The drift as a modal force -w^2 r t q in continuous time. The damping force 2 zeta w dq/dt does not change,
/// because only the stiffness changes.
struct Drifting {
    rate_per_s: f64,
    law: Course,
    /// For each mode, the natural frequency in rad/s and the vector by which a modal force enters dx/dt.
    modes: Vec<(f64, Vec<f64>)>,
}

impl StructureEffect for Drifting {
    fn add_rate(&self, t_s: f64, x: &[f64], rate: &mut [f64]) {
        let t_s = self.law.at(t_s);
        for (m, (w, entry)) in self.modes.iter().enumerate() {
            add_scaled(rate, entry, -w * self.rate_per_s * t_s * x[mode_state(m)]);
        }
    }
}

impl Law for StiffnessDrift {
    fn check(&self, limits: &Limits) -> Result<(), TestbedError> {
        let (rate, end_s) = (self.rate_per_s, limits.end_s);
        finite("rate_per_s", rate)?;
        self.law.check()?;
        if 1.0 + rate * self.law.at(end_s) <= 0.0 { Err(TestbedError::NoStiffness { rate, end_s }) } else { Ok(()) }
    }

    fn install(&self, site: Site, chain: &mut Chain) {
        let modes = &site.truss.modes;
        let modes = (0..modes.len()).map(|m| (modes[m].angular_frequency(), modal_force(modes, m))).collect();
        chain.structure.push(Box::new(Drifting { rate_per_s: self.rate_per_s, law: self.law, modes }));
    }

    fn strengthen(&mut self, factor: f64) {
        self.rate_per_s *= factor;
    }

    fn place(&self) -> usize {
        0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.rate_per_s]
    }

    fn own_equation(&self) -> bool {
        self.law == Course::Linear
    }
}

impl Described for StiffnessDrift {
    const FAMILY: Family = Family::Time;
    const AT: At = At::Whole;
    const ON: &'static [On] = &[On::Structure];
    const PARAMETERS: &'static [&'static str] = &["r"];
    const NEAR_MISSES: &'static [&'static str] = &["settling"];
    const SHAPES: &'static [Shape] = Course::SHAPES;
    const IMPERFECTION: bool = true;

    fn start(draw: &mut Draw<'_>) -> Value {
        json!({ "rate_per_s": draw.sign * 1e-4 })
    }
}
