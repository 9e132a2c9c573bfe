//! An amplifier with a limited slew rate: |du'/dt| <= R, also between samples.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::INPUTS;
use crate::config::positive;
use crate::effects::chain::{ActuatorEffect, Chain, Site, Span};
use crate::effects::family::{Halves, Shape};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Input;
use crate::effects::written::{self, Laws};
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;

/// u' follows u with |du'/dt| <= R.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActuatorSlewLimit {
    /// The input.
    pub at: Input,
    /// R, V/s; positive.
    pub rate_v_per_s: f64,
    /// The way in which u' follows u.
    #[serde(default, with = "written")]
    pub law: SlewLaw,
}

/// Ways to follow a voltage no faster than R.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum SlewLaw {
    /// Moves at rate R until the target is reached.
    #[default]
    Hard,
    /// du'/dt = R tanh((u - u') / e): slower near the target.
    Soft {
        /// e, V; positive.
        within_v: f64,
    },
}

impl Laws for SlewLaw {
    /// An amplifier whose input stage saturates slews while its error exceeds e. Commands have about 1 V RMS. With
    /// the smallest e, the law is almost the hard limit, to which it tends; with the largest e, the amplifier seldom
    /// slews at its full rate.
    const SHAPES: &'static [Shape] = &[Shape {
        law: "soft",
        number: "within_v",
        fixed: 0.1,
        ranges: Halves { development: &[[0.07, 0.15]], reported: &[[0.02, 0.05], [0.25, 0.5]] },
    }];
}

struct Slewing {
    input: usize,
    rate: f64,
    law: SlewLaw,
    voltage: f64,
}

/// Returns the distance to the target after `t`, if it is `left` at first.
fn remaining(law: SlewLaw, left: f64, rate: f64, t: f64) -> f64 {
    let size = match law {
        SlewLaw::Hard => (left.abs() - rate * t).max(0.0),
        SlewLaw::Soft { within_v: e } => {
            // With w = left / e: dw/dt = -tanh(w) R / e, so sinh(w) decays as exp(-R t / e). For w far above 1,
            // sinh(w) is an exponential.
            let w = left.abs() / e;
            let steps = rate * t / e;
            let end = if w - steps > 20.0 { w - steps } else { (log_sinh(w) - steps).exp().asinh() };
            end * e
        }
    };
    size * left.signum()
}

fn log_sinh(w: f64) -> f64 {
    if w > 20.0 { w - std::f64::consts::LN_2 } else { w.sinh().ln() }
}

impl ActuatorEffect for Slewing {
    fn apply(&mut self, span: &Span, u: &mut [[f64; INPUTS]]) {
        for (piece, length_s) in u.iter_mut().zip(span.lengths_s()) {
            let target = piece[self.input];
            let left = target - self.voltage;
            let to_go = |t: f64| remaining(self.law, left, self.rate, t);
            let mean = match self.law {
                // The area under a triangle, which the end of the piece may cut off.
                SlewLaw::Hard => {
                    let ramp_s = (left.abs() / self.rate).min(length_s);
                    ramp_s * (left + to_go(ramp_s)) / 2.0 / length_s
                }
                // Simpson's rule over twenty parts.
                SlewLaw::Soft { .. } => {
                    let part = |i: usize| to_go(length_s * i as f64 / 20.0);
                    let weight = |i: usize| if i == 0 || i == 20 { 1.0 } else { 2.0 + 2.0 * (i % 2) as f64 };
                    (0..=20).map(|i| weight(i) * part(i)).sum::<f64>() / 60.0
                }
            };
            self.voltage = target - to_go(length_s);
            piece[self.input] = target - mean;
        }
    }
}

impl Law for ActuatorSlewLimit {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("rate_v_per_s", self.rate_v_per_s)?;
        match self.law {
            SlewLaw::Hard => Ok(()),
            SlewLaw::Soft { within_v } => positive("law.within_v", within_v),
        }
    }

    fn install(&self, _site: Site, chain: &mut Chain) {
        let (input, rate, law) = (self.at.0, self.rate_v_per_s, self.law);
        chain.actuator.push(Box::new(Slewing { input, rate, law, voltage: 0.0 }));
        chain.moves_within = true;
    }

    fn strengthen(&mut self, factor: f64) {
        self.rate_v_per_s /= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.rate_v_per_s]
    }

    fn own_equation(&self) -> bool {
        self.law == SlewLaw::Hard
    }
}

impl Described for ActuatorSlewLimit {
    const FAMILY: Family = Family::NonlinearActuator;
    const AT: At = At::Input;
    const ON: &'static [On] = &[On::Structure, On::Command, On::Reference];
    const PARAMETERS: &'static [&'static str] = &["R"];
    const NEAR_MISSES: &'static [&'static str] = &["soft"];
    const SHAPES: &'static [Shape] = SlewLaw::SHAPES;
    const IMPERFECTION: bool = true;

    fn start(_draw: &mut Draw<'_>) -> Value {
        json!({ "rate_v_per_s": 1500.0 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_soft_law_agrees_with_a_fine_integration() {
        let within: [f64; 3] = [0.02, 0.1, 0.5];
        for (left, e) in [0.01, 0.5, 5.0, 60.0].into_iter().flat_map(|left| within.map(|e| (left, e))) {
            let (rate, mut fine) = (2000.0, left);
            let h = 1e-8;
            for _ in 0..60_000 {
                fine -= h * rate * (fine / e).tanh();
            }
            let closed = remaining(SlewLaw::Soft { within_v: e }, left, rate, 6e-4);
            assert!((closed - fine).abs() < 1e-4 * left, "{left}: {closed} and {fine}");
            let [soft, hard] =
                [SlewLaw::Soft { within_v: 1e-9 }, SlewLaw::Hard].map(|law| remaining(law, left, rate, 6e-4));
            assert!((soft - hard).abs() < 1e-7, "{left}: {soft} and {hard}");
        }
    }

    #[test]
    fn a_ramp_has_the_mean_of_its_area() {
        let mut slewing = Slewing { input: 0, rate: 1000.0, law: SlewLaw::Hard, voltage: 0.0 };
        let span = Span { start_s: 0.0, sample_s: 1e-3, edges: &[0.0, 0.25, 1.0] };
        let mut u = [[0.5, 0.0, 0.0]; 2];
        slewing.apply(&span, &mut u);
        // The voltage rises to 0.25 V in the first quarter, then to 0.5 V in another 0.25 ms, and stays there for 0.5
        // ms.
        assert!((u[0][0] - 0.125).abs() < 1e-12, "{u:?}");
        assert!((u[1][0] - (0.375 * 0.25 + 0.5 * 0.5) / 0.75).abs() < 1e-12, "{u:?}");
    }
}
