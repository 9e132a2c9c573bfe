//! A sensor with a limited rate: |y'_k - y'_{k-1}| <= R / fs.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::positive;
use crate::effects::chain::{Chain, Site};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Output;
use crate::effects::{At, Described, Draw, Family, Half, On};
use crate::error::TestbedError;

/// y' follows y at a rate of at most R.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorRateLimit {
    /// The output.
    pub at: Output,
    /// R, V/s; positive.
    pub rate_v_per_s: f64,
}

impl Law for SensorRateLimit {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("rate_v_per_s", self.rate_v_per_s)
    }

    fn install(&self, site: Site, chain: &mut Chain) {
        let most = self.rate_v_per_s / site.clock.sample_rate_hz;
        let mut last = 0.0;
        chain.change_output(self.at.0, move |y, _t| {
            last += (y - last).clamp(-most, most);
            last
        });
    }

    fn strengthen(&mut self, factor: f64) {
        self.rate_v_per_s /= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.rate_v_per_s]
    }
}

impl Described for SensorRateLimit {
    const FAMILY: Family = Family::Outside(Half::Development);
    const AT: At = At::Output;
    const ON: &'static [On] = &[On::Structure, On::Sensor];

    fn start(draw: &mut Draw<'_>) -> Value {
        json!({ "rate_v_per_s": 1000.0 * draw.level.output })
    }
}
