//! A coarser code: y' = q round(y / q) of the ADC's value.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::positive;
use crate::effects::chain::{Chain, Clock, SensorEffect, Site};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Output;
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;
use ndarray::Array2;

/// y' = q round(y / q).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorQuantisation {
    /// The output.
    pub at: Output,
    /// q, V; positive.
    pub step_v: f64,
    /// The rounding.
    #[serde(default)]
    pub law: QuantisationLaw,
}

/// Ways to round.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum QuantisationLaw {
    /// To the nearest code.
    #[default]
    Round,
    /// Towards zero: bits that are cut off.
    Truncate,
}

impl SensorEffect for SensorQuantisation {
    fn apply(&mut self, _clock: Clock, y: &mut Array2<f64>) {
        let round = if self.law == QuantisationLaw::Round { f64::round } else { f64::trunc };
        y.column_mut(self.at.0).mapv_inplace(|y| self.step_v * round(y / self.step_v));
    }
}

impl Law for SensorQuantisation {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("step_v", self.step_v)
    }

    fn install(&self, _site: Site, chain: &mut Chain) {
        chain.codes.push(Box::new(self.clone()));
    }

    fn strengthen(&mut self, factor: f64) {
        self.step_v *= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.step_v]
    }

    fn own_equation(&self) -> bool {
        self.law == QuantisationLaw::Round
    }
}

impl Described for SensorQuantisation {
    const FAMILY: Family = Family::NonlinearSensor;
    const AT: At = At::Output;
    const ON: &'static [On] = &[On::Structure, On::Sensor];
    const PARAMETERS: &'static [&'static str] = &["q"];
    const NEAR_MISSES: &'static [&'static str] = &["truncate"];
    const IMPERFECTION: bool = true;

    fn start(_draw: &mut Draw<'_>) -> Value {
        json!({ "step_v": 0.05 })
    }
}
