//! A supply that sags when several actuators push at once: u'_j = u_j / (1 + s (|u_1| + |u_2| + ...)).

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::INPUTS;
use crate::config::positive;
use crate::effects::chain::{ActuatorEffect, Chain, Site, Span};
use crate::effects::law::{Law, Limits};
use crate::effects::{At, Described, Draw, Family, Half, On};
use crate::error::TestbedError;

/// u'_j = u_j / (1 + s sum |u_l|) for every input j, with the sum over all inputs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SupplySag {
    /// s, 1/V; positive.
    pub sag_per_v: f64,
}

impl ActuatorEffect for SupplySag {
    fn apply(&mut self, _span: &Span, u: &mut [[f64; INPUTS]]) {
        for piece in u {
            let left = 1.0 / (1.0 + self.sag_per_v * piece.iter().map(|u| u.abs()).sum::<f64>());
            piece.iter_mut().for_each(|u| *u *= left);
        }
    }
}

impl Law for SupplySag {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("sag_per_v", self.sag_per_v)
    }

    fn install(&self, _site: Site, chain: &mut Chain) {
        chain.actuator.push(Box::new(self.clone()));
    }

    fn strengthen(&mut self, factor: f64) {
        self.sag_per_v *= factor;
    }

    fn place(&self) -> usize {
        INPUTS
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.sag_per_v]
    }
}

impl Described for SupplySag {
    const FAMILY: Family = Family::Outside(Half::Reported);
    const AT: At = At::Whole;
    const ON: &'static [On] = &[On::Structure];
    // With only one actuator, the effect would be a law of its command.
    const LEAST_INPUTS: usize = 2;

    fn start(_draw: &mut Draw<'_>) -> Value {
        json!({ "sag_per_v": 0.03 })
    }
}
