//! An actuator whose delay differs from command to command.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::INPUTS;
use crate::config::{not_negative, positive};
use crate::effects::chain::{ActuatorEffect, Chain, Site, Span};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Input;
use crate::effects::{At, Described, Draw, Family, Half, On};
use crate::error::TestbedError;
use rand::RngExt;
use rand_chacha::ChaCha12Rng;

/// Each command acts after a separate delay, uniform from 0 to tau.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DelayJitter {
    /// The input.
    pub at: Input,
    /// tau, samples; positive, at most 1.
    pub most_samples: f64,
}

struct Jittering {
    input: usize,
    most: f64,
    before: f64,
    rng: ChaCha12Rng,
}

impl ActuatorEffect for Jittering {
    fn apply(&mut self, span: &Span, u: &mut [[f64; INPUTS]]) {
        let delay = self.most * self.rng.random::<f64>();
        let mut last = self.before;
        for (piece, edges) in u.iter_mut().zip(span.edges.windows(2)) {
            let old = (delay.clamp(edges[0], edges[1]) - edges[0]) / (edges[1] - edges[0]);
            last = piece[self.input];
            piece[self.input] = old * self.before + (1.0 - old) * last;
        }
        self.before = last;
    }
}

impl Law for DelayJitter {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("most_samples", self.most_samples)?;
        not_negative("1 - most_samples", 1.0 - self.most_samples)
    }

    fn install(&self, site: Site, chain: &mut Chain) {
        let (input, most) = (self.at.0, self.most_samples);
        chain.actuator.push(Box::new(Jittering { input, most, before: 0.0, rng: site.rng }));
        chain.moves_within = true;
    }

    fn strengthen(&mut self, factor: f64) {
        self.most_samples = (self.most_samples * factor).min(1.0);
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.most_samples]
    }

    fn foretold(&self) -> bool {
        false
    }
}

impl Described for DelayJitter {
    const FAMILY: Family = Family::Outside(Half::Development);
    const AT: At = At::Input;
    const ON: &'static [On] = &[On::Structure, On::Command, On::Reference];

    fn start(_draw: &mut Draw<'_>) -> Value {
        json!({ "most_samples": 0.3 })
    }
}
