//! Dry friction that sticks. At rest, it holds the port of one input against forces up to a limit. This limit is at
//! least as large as the force with which it brakes a port that slides.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::{not_negative, positive};
use crate::effects::chain::{Chain, Site, StructureEffect, add_scaled, dot};
use crate::effects::family::{Halves, Shape};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Input;
use crate::effects::written::{self, Laws};
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;
use crate::plant::StrutPort;
use crate::state_space::multiply_add;

/// f = -(Fc + (Fs - Fc) exp(-(v / vs)^2)) sign(v); at v = 0 the force that keeps v = 0, of at most Fs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StickFriction {
    /// The input at whose port it acts.
    pub at: Input,
    /// Fc, V; positive.
    pub slides_v: f64,
    /// Fs, V; at least Fc.
    pub holds_v: f64,
    /// vs, V/s; positive.
    pub transition_v_per_s: f64,
    /// The curve by which the force falls from Fs to Fc.
    #[serde(default, with = "written")]
    pub law: StickLaw,
}

/// Curves by which friction falls as a port begins to slide.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum StickLaw {
    /// exp(-(v / vs)^2)
    #[default]
    Gaussian,
    /// (1 + (v / vs)^2 / p)^-p: Lorentz's curve at p = 1
    Lorentzian {
        /// p; positive.
        exponent: f64,
    },
}

impl Laws for StickLaw {
    /// A film of oil carries more and more of the load as the speed grows, in thick oil far beyond vs. The smaller p
    /// is, the longer is the tail of the fall. As p grows, the curve tends to the vocabulary's exp(-(v / vs)^2).
    const SHAPES: &'static [Shape] = &[Shape {
        law: "lorentzian",
        number: "exponent",
        fixed: 1.0,
        ranges: Halves { development: &[[0.8, 1.4]], reported: &[[0.4, 0.65], [2.0, 4.0]] },
    }];
}

/// Moreau's time stepping with a force that is constant over a step: the force that stops the port at the end of the
/// step, or the largest force that the friction can exert. Over h, a force f adds (h b + h^2 / 2 A b) f to the state,
/// up to terms in h^3.
struct Sticking {
    port: StrutPort,
    friction: StickFriction,
    /// A b, where b is the contribution of a force of 1 V to dx/dt.
    later: Vec<f64>,
}

impl StructureEffect for Sticking {
    fn add_rate(&self, _t_s: f64, _x: &[f64], _rate: &mut [f64]) {}

    fn settle(&self, h_s: f64, x: &mut [f64]) {
        let v = dot(&self.port.velocity, x);
        let by_one =
            h_s * dot(&self.port.velocity, &self.port.force) + h_s * h_s / 2.0 * dot(&self.port.velocity, &self.later);
        let most = self.friction.limit(v);
        let force = (-v / by_one).clamp(-most, most);
        add_scaled(x, &self.port.force, h_s * force);
        add_scaled(x, &self.later, h_s * h_s / 2.0 * force);
    }
}

impl StickFriction {
    /// Returns the largest force at a velocity, V.
    fn limit(&self, v: f64) -> f64 {
        let square = (v / self.transition_v_per_s).powi(2);
        let share = match self.law {
            StickLaw::Gaussian => (-square).exp(),
            StickLaw::Lorentzian { exponent } => 1.0 / (1.0 + square / exponent).powf(exponent),
        };
        self.slides_v + (self.holds_v - self.slides_v) * share
    }
}

impl Law for StickFriction {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("slides_v", self.slides_v)?;
        not_negative("holds_v - slides_v", self.holds_v - self.slides_v)?;
        positive("transition_v_per_s", self.transition_v_per_s)?;
        match self.law {
            StickLaw::Gaussian => Ok(()),
            StickLaw::Lorentzian { exponent } => positive("law.exponent", exponent),
        }
    }

    fn install(&self, site: Site, chain: &mut Chain) {
        let port = site.truss.ports[self.at.0].clone();
        let mut later = vec![0.0; port.force.len()];
        multiply_add(&site.truss.continuous.a, &port.force, &mut later);
        chain.structure.push(Box::new(Sticking { port, friction: self.clone(), later }));
    }

    fn strengthen(&mut self, factor: f64) {
        self.slides_v *= factor;
        self.holds_v *= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.slides_v, self.holds_v, self.transition_v_per_s]
    }

    fn own_equation(&self) -> bool {
        self.law == StickLaw::Gaussian
    }
}

impl Described for StickFriction {
    const FAMILY: Family = Family::NonlinearStructure;
    const AT: At = At::Port;
    const ON: &'static [On] = &[On::Axis];
    const PARAMETERS: &'static [&'static str] = &["Fc", "Fs", "vs"];
    const NEAR_MISSES: &'static [&'static str] = &["lorentzian"];
    const SHAPES: &'static [Shape] = StickLaw::SHAPES;

    fn start(draw: &mut Draw<'_>) -> Value {
        let holds_v = 0.05 * draw.within(1.1..1.6);
        let transition_v_per_s = draw.within(0.05..0.3) * draw.level.velocity;
        json!({ "slides_v": 0.05, "holds_v": holds_v, "transition_v_per_s": transition_v_per_s })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lorentz's curves tend to that of Gauss, and the one at p = 1 is 1 / (1 + (v / vs)^2).
    #[test]
    fn a_large_exponent_is_the_vocabulary_s_own_law() {
        let limit = |law: StickLaw, v: f64| {
            StickFriction { at: Input(0), slides_v: 0.5, holds_v: 0.8, transition_v_per_s: 3.0, law }.limit(v)
        };
        for v in [0.0, -1.0, 2.0, 5.0, 30.0] {
            let [gauss, near] = [StickLaw::Gaussian, StickLaw::Lorentzian { exponent: 1e9 }].map(|law| limit(law, v));
            assert!((gauss - near).abs() < 1e-6, "{v}: {gauss} and {near}");
            let lorentz = limit(StickLaw::Lorentzian { exponent: 1.0 }, v);
            assert!((lorentz - (0.5 + 0.3 / (1.0 + v * v / 9.0))).abs() < 1e-12, "{v}: {lorentz}");
        }
    }
}
