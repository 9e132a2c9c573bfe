//! Play in a command: u' follows once the play is taken up.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::INPUTS;
use crate::config::positive;
use crate::effects::chain::{ActuatorEffect, Chain, Site, Span};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Input;
use crate::effects::{At, Described, Draw, Family, Half, On};
use crate::error::TestbedError;

/// u' stays within b of u, and moves only when pushed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CommandPlay {
    /// The input.
    pub at: Input,
    /// b, half the play, V; positive.
    pub play_v: f64,
}

struct Pushed {
    input: usize,
    play: f64,
    voltage: f64,
}

impl ActuatorEffect for Pushed {
    fn apply(&mut self, _span: &Span, u: &mut [[f64; INPUTS]]) {
        for piece in u {
            let command = piece[self.input];
            self.voltage = self.voltage.clamp(command - self.play, command + self.play);
            piece[self.input] = self.voltage;
        }
    }
}

impl Law for CommandPlay {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("play_v", self.play_v)
    }

    fn install(&self, _site: Site, chain: &mut Chain) {
        chain.actuator.push(Box::new(Pushed { input: self.at.0, play: self.play_v, voltage: 0.0 }));
    }

    fn strengthen(&mut self, factor: f64) {
        self.play_v *= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.play_v]
    }
}

impl Described for CommandPlay {
    const FAMILY: Family = Family::Outside(Half::Development);
    const AT: At = At::Input;
    const ON: &'static [On] = &[On::Structure];
    const IMPERFECTION: bool = true;

    fn start(_draw: &mut Draw<'_>) -> Value {
        json!({ "play_v": 0.1 })
    }
}
