//! A sensor with a different gain: y' = g y.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::finite;
use crate::effects::chain::{Chain, Site};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Output;
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;

/// y' = g y.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorGain {
    /// The output.
    pub at: Output,
    /// g.
    pub gain: f64,
}

impl Law for SensorGain {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        finite("gain", self.gain)
    }

    fn install(&self, _site: Site, chain: &mut Chain) {
        let gain = self.gain;
        chain.change_output(self.at.0, move |y, _t| gain * y);
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

impl Described for SensorGain {
    const FAMILY: Family = Family::LinearSensor;
    const AT: At = At::Output;
    const ON: &'static [On] = &[On::Structure, On::Channels];
    const PARAMETERS: &'static [&'static str] = &["g"];
    const IMPERFECTION: bool = true;

    fn start(draw: &mut Draw<'_>) -> Value {
        json!({ "gain": 1.0 + draw.sign * 0.05 })
    }
}
