//! An actuator that weakens as it warms up: u' = u / (1 + s h), where h follows its power.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::INPUTS;
use crate::config::positive;
use crate::effects::chain::{ActuatorEffect, Chain, Site, Span};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Input;
use crate::effects::{At, Described, Draw, Family, Half, On};
use crate::error::TestbedError;

/// u' = u / (1 + s h), dh/dt = (u^2 - h) / tau. The actuator is cold at the start of a record.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ThermalGain {
    /// The input.
    pub at: Input,
    /// s, 1/V^2; positive.
    pub loss_per_v2: f64,
    /// tau, s; positive.
    pub time_s: f64,
}

struct Warm {
    input: usize,
    loss: f64,
    time_s: f64,
    /// h, V^2.
    heat: f64,
}

impl ActuatorEffect for Warm {
    fn apply(&mut self, span: &Span, u: &mut [[f64; INPUTS]]) {
        for (piece, length_s) in u.iter_mut().zip(span.lengths_s()) {
            let power = piece[self.input].powi(2);
            let (ahead, shares) = (self.heat - power, length_s / self.time_s);
            // The mean of h over the piece.
            let heat = power - ahead * (-shares).exp_m1() / shares;
            self.heat = power + ahead * (-shares).exp();
            piece[self.input] /= 1.0 + self.loss * heat;
        }
    }
}

impl Law for ThermalGain {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("loss_per_v2", self.loss_per_v2)?;
        positive("time_s", self.time_s)
    }

    fn install(&self, _site: Site, chain: &mut Chain) {
        let (input, loss, time_s) = (self.at.0, self.loss_per_v2, self.time_s);
        chain.actuator.push(Box::new(Warm { input, loss, time_s, heat: 0.0 }));
    }

    fn strengthen(&mut self, factor: f64) {
        self.loss_per_v2 *= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.loss_per_v2, self.time_s]
    }
}

impl Described for ThermalGain {
    const FAMILY: Family = Family::Outside(Half::Reported);
    const AT: At = At::Input;
    const ON: &'static [On] = &[On::Structure, On::Command];

    fn start(draw: &mut Draw<'_>) -> Value {
        json!({ "loss_per_v2": 0.1, "time_s": draw.within(0.03..0.3) })
    }
}
