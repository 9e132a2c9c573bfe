//! Cross-talk from one sensor's signal to another sensor's line: y'_j = y_j + c y_i.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::finite;
use crate::effects::chain::{Chain, Clock, SensorEffect, Site};
use crate::effects::law::{Law, Limits};
use crate::effects::place::OutputPair;
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;
use ndarray::Array2;

/// y'_j = y_j + c y_i.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorCrosstalk {
    /// From output i into output j.
    pub at: OutputPair,
    /// c; either sign.
    pub share: f64,
}

impl SensorEffect for SensorCrosstalk {
    fn apply(&mut self, _clock: Clock, y: &mut Array2<f64>) {
        for mut sample in y.rows_mut() {
            sample[self.at.1] += self.share * sample[self.at.0];
        }
    }
}

impl Law for SensorCrosstalk {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        finite("share", self.share)
    }

    fn install(&self, _site: Site, chain: &mut Chain) {
        chain.sensor.push(Box::new(self.clone()));
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

impl Described for SensorCrosstalk {
    const FAMILY: Family = Family::LinearSensor;
    const AT: At = At::OutputPair;
    const ON: &'static [On] = &[On::Structure, On::Channels];
    const PARAMETERS: &'static [&'static str] = &["c"];
    const IMPERFECTION: bool = true;

    fn start(draw: &mut Draw<'_>) -> Value {
        json!({ "share": draw.sign * 0.05 })
    }
}
