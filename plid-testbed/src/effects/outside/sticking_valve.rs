//! A valve that sticks and then jumps: u' stays constant until u differs from it by more than s, and then becomes u.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::INPUTS;
use crate::config::positive;
use crate::effects::chain::{ActuatorEffect, Chain, Site, Span};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Input;
use crate::effects::{At, Described, Draw, Family, Half, On};
use crate::error::TestbedError;

/// u' stays until |u - u'| > s, then u' = u.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StickingValve {
    /// The input.
    pub at: Input,
    /// s, V; positive.
    pub stick_v: f64,
}

struct Sticking {
    input: usize,
    stick: f64,
    voltage: f64,
}

impl ActuatorEffect for Sticking {
    fn apply(&mut self, _span: &Span, u: &mut [[f64; INPUTS]]) {
        for piece in u {
            if (piece[self.input] - self.voltage).abs() > self.stick {
                self.voltage = piece[self.input];
            }
            piece[self.input] = self.voltage;
        }
    }
}

impl Law for StickingValve {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("stick_v", self.stick_v)
    }

    fn install(&self, _site: Site, chain: &mut Chain) {
        chain.actuator.push(Box::new(Sticking { input: self.at.0, stick: self.stick_v, voltage: 0.0 }));
    }

    fn strengthen(&mut self, factor: f64) {
        self.stick_v *= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.stick_v]
    }
}

impl Described for StickingValve {
    const FAMILY: Family = Family::Outside(Half::Development);
    const AT: At = At::Input;
    const ON: &'static [On] = &[On::Structure, On::Command];

    fn start(_draw: &mut Draw<'_>) -> Value {
        json!({ "stick_v": 0.1 })
    }
}
