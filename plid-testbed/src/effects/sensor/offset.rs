//! A sensor with a constant offset: y' = y + o.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::finite;
use crate::effects::chain::{Chain, Site};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Output;
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;

/// y' = y + o.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorOffset {
    /// The output.
    pub at: Output,
    /// o, V; either sign.
    pub offset_v: f64,
}

impl Law for SensorOffset {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        finite("offset_v", self.offset_v)
    }

    fn install(&self, _site: Site, chain: &mut Chain) {
        let offset = self.offset_v;
        chain.change_output(self.at.0, move |y, _t| y + offset);
    }

    fn strengthen(&mut self, factor: f64) {
        self.offset_v *= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.offset_v]
    }
}

impl Described for SensorOffset {
    const FAMILY: Family = Family::AddedBySensor;
    const AT: At = At::Output;
    const ON: &'static [On] = &[On::Structure, On::Sensor];
    const PARAMETERS: &'static [&'static str] = &["o"];
    const IMPERFECTION: bool = true;

    fn start(draw: &mut Draw<'_>) -> Value {
        json!({ "offset_v": draw.sign * 0.02 })
    }
}
