//! Cross-talk from one channel's voltage to another channel's actuator: u'_j = u_j + c u_i.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::INPUTS;
use crate::config::finite;
use crate::effects::chain::{ActuatorEffect, Chain, Site, Span};
use crate::effects::law::{Law, Limits};
use crate::effects::place::InputPair;
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;

/// u'_j = u_j + c u_i.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActuatorCrosstalk {
    /// From input i into input j.
    pub at: InputPair,
    /// c; either sign.
    pub share: f64,
}

impl ActuatorEffect for ActuatorCrosstalk {
    fn apply(&mut self, _span: &Span, u: &mut [[f64; INPUTS]]) {
        for piece in u {
            piece[self.at.1] += self.share * piece[self.at.0];
        }
    }
}

impl Law for ActuatorCrosstalk {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        finite("share", self.share)
    }

    fn install(&self, _site: Site, chain: &mut Chain) {
        chain.actuator.push(Box::new(self.clone()));
    }

    fn strengthen(&mut self, factor: f64) {
        self.share *= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.share, self.at.1 as f64]
    }
}

impl Described for ActuatorCrosstalk {
    const FAMILY: Family = Family::LinearActuator;
    const AT: At = At::InputPair;
    const ON: &'static [On] = &[On::Structure, On::Channels];
    const PARAMETERS: &'static [&'static str] = &["c"];
    const IMPERFECTION: bool = true;

    fn start(draw: &mut Draw<'_>) -> Value {
        json!({ "share": draw.sign * 0.2 })
    }
}
