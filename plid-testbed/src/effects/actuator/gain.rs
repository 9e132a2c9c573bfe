//! An actuator with a different gain: u' = g u.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::finite;
use crate::effects::chain::{Chain, Site};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Input;
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;

/// u' = g u.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActuatorGain {
    /// The input.
    pub at: Input,
    /// g.
    pub gain: f64,
}

impl Law for ActuatorGain {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        finite("gain", self.gain)
    }

    fn install(&self, _site: Site, chain: &mut Chain) {
        let gain = self.gain;
        chain.change_inputs(vec![self.at.0], move |u| gain * u);
    }

    fn strengthen(&mut self, factor: f64) {
        self.gain = 1.0 + factor * (self.gain - 1.0);
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.gain]
    }
}

impl Described for ActuatorGain {
    const FAMILY: Family = Family::LinearActuator;
    const AT: At = At::Input;
    const ON: &'static [On] = &[On::Structure, On::Gain];
    const PARAMETERS: &'static [&'static str] = &["g"];
    const IMPERFECTION: bool = true;

    fn start(draw: &mut Draw<'_>) -> Value {
        json!({ "gain": 1.0 + draw.sign * 0.2 })
    }
}
