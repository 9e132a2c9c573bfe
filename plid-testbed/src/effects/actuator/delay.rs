//! An actuator with a delay: u'(t) = u(t - tau) of the held command, also for fractions of a sample.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::INPUTS;
use crate::config::positive;
use crate::effects::chain::{ActuatorEffect, Chain, Site, Span};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Inputs;
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;

/// u'(t) = u(t - tau).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActuatorDelay {
    /// One input, or all.
    pub at: Inputs,
    /// tau, samples; positive, at most 1000.
    pub delay_samples: f64,
}

struct Delayed {
    inputs: Vec<usize>,
    delay: f64,
    /// The latest samples, the newest first.
    past: VecDeque<Vec<[f64; INPUTS]>>,
}

impl ActuatorEffect for Delayed {
    fn apply(&mut self, span: &Span, u: &mut [[f64; INPUTS]]) {
        self.past.push_front(u.to_vec());
        self.past.truncate(self.delay.ceil() as usize + 1);
        for (piece, edges) in u.iter_mut().zip(span.edges.windows(2)) {
            for &j in &self.inputs {
                piece[j] = self.mean(j, span.edges, edges[0] - self.delay, edges[1] - self.delay);
            }
        }
    }
}

impl Delayed {
    /// Returns the mean of an input between two times, in samples since the newest one began. Before the record, the
    /// input is zero.
    fn mean(&self, input: usize, edges: &[f64], from: f64, to: f64) -> f64 {
        let mut area = 0.0;
        for (age, sample) in self.past.iter().enumerate() {
            let start = -(age as f64);
            if start >= to || start + 1.0 <= from {
                continue;
            }
            for (piece, w) in sample.iter().zip(edges.windows(2)) {
                let overlap = (start + w[1]).min(to) - (start + w[0]).max(from);
                area += overlap.max(0.0) * piece[input];
            }
        }
        area / (to - from)
    }
}

impl Law for ActuatorDelay {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("delay_samples", self.delay_samples)?;
        positive("1000 - delay_samples", 1000.0 - self.delay_samples)
    }

    fn install(&self, _site: Site, chain: &mut Chain) {
        chain.jumps.push(self.delay_samples.fract());
        let (inputs, delay) = (self.at.channels(), self.delay_samples);
        chain.actuator.push(Box::new(Delayed { inputs, delay, past: VecDeque::new() }));
    }

    fn strengthen(&mut self, factor: f64) {
        self.delay_samples *= factor;
    }

    fn place(&self) -> usize {
        match self.at {
            Inputs::One(j) => j,
            Inputs::All => INPUTS,
        }
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.delay_samples]
    }
}

impl Described for ActuatorDelay {
    const FAMILY: Family = Family::LinearActuator;
    const AT: At = At::InputOrAll;
    const ON: &'static [On] = &[On::Structure, On::Command, On::Reference];
    const PARAMETERS: &'static [&'static str] = &["tau"];
    const IMPERFECTION: bool = true;

    fn start(_draw: &mut Draw<'_>) -> Value {
        json!({ "delay_samples": 0.3 })
    }
}
