//! A coarser code, applied to the ADC's value: y' = q round(y / q).

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::{finite, positive};
use crate::effects::chain::{Chain, Clock, SensorEffect, Site};
use crate::effects::family::{Halves, Shape};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Output;
use crate::effects::written::{self, Laws};
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
    #[serde(default, with = "written")]
    pub law: QuantisationLaw,
}

/// Ways to round.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum QuantisationLaw {
    /// To the nearest code.
    #[default]
    Round,
    /// The code of k steps begins at k - c steps in magnitude. With c = 0, bits are cut off.
    Truncate {
        /// c; below one.
        carry: f64,
    },
}

impl Laws for QuantisationLaw {
    /// The thresholds of comparators depend on their offsets. With c = 1/2, values are rounded, which is the
    /// vocabulary's law. With c below zero, the code of zero is wider than two steps.
    const SHAPES: &'static [Shape] = &[Shape {
        law: "truncate",
        number: "carry",
        fixed: 0.0,
        ranges: Halves { development: &[[-0.05, 0.12]], reported: &[[-0.3, -0.1], [0.2, 0.35]] },
    }];
}

impl SensorEffect for SensorQuantisation {
    fn apply(&mut self, _clock: Clock, y: &mut Array2<f64>) {
        let code = |steps: f64| match self.law {
            QuantisationLaw::Round => steps.round(),
            QuantisationLaw::Truncate { carry } => (steps.abs() + carry).max(0.0).trunc().copysign(steps),
        };
        y.column_mut(self.at.0).mapv_inplace(|y| self.step_v * code(y / self.step_v));
    }
}

impl Law for SensorQuantisation {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("step_v", self.step_v)?;
        match self.law {
            QuantisationLaw::Round => Ok(()),
            QuantisationLaw::Truncate { carry } => {
                finite("law.carry", carry)?;
                positive("1 - law.carry", 1.0 - carry)
            }
        }
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
    const SHAPES: &'static [Shape] = QuantisationLaw::SHAPES;
    const IMPERFECTION: bool = true;

    fn start(_draw: &mut Draw<'_>) -> Value {
        json!({ "step_v": 0.05 })
    }
}
