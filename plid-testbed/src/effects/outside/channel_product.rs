//! A sensor that picks up the product of two others: y'_i = y_i + c y_j y_l.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::OUTPUTS;
use crate::config::finite;
use crate::effects::chain::{Chain, Clock, SensorEffect, Site};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Output;
use crate::effects::{At, Described, Draw, Family, Half, On};
use crate::error::TestbedError;
use ndarray::Array2;

/// y'_i = y_i + c y_j y_l, where j and l are the two other outputs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChannelProduct {
    /// The output.
    pub at: Output,
    /// c, 1/V; either sign.
    pub product_per_v: f64,
}

impl SensorEffect for ChannelProduct {
    fn apply(&mut self, _clock: Clock, y: &mut Array2<f64>) {
        for mut sample in y.rows_mut() {
            let others: f64 = (1..OUTPUTS).map(|step| sample[(self.at.0 + step) % OUTPUTS]).product();
            sample[self.at.0] += self.product_per_v * others;
        }
    }
}

impl Law for ChannelProduct {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        finite("product_per_v", self.product_per_v)
    }

    fn install(&self, _site: Site, chain: &mut Chain) {
        chain.sensor.push(Box::new(self.clone()));
    }

    fn strengthen(&mut self, factor: f64) {
        self.product_per_v *= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.product_per_v]
    }
}

impl Described for ChannelProduct {
    const FAMILY: Family = Family::Outside(Half::Development);
    const AT: At = At::Output;
    const ON: &'static [On] = &[On::Structure];
    // The product needs two other outputs.
    const LEAST_OUTPUTS: usize = 3;

    fn start(draw: &mut Draw<'_>) -> Value {
        json!({ "product_per_v": draw.sign * 0.1 / draw.level.output })
    }
}
