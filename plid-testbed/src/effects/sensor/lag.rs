//! A slow sensor: y'_k = al y'_{k-1} + (1 - al) y_k, al = exp(-2 pi fc / fs).

use std::f64::consts::PI;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::positive;
use crate::effects::chain::{Chain, Site};
use crate::effects::family::{Halves, Shape};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Output;
use crate::effects::written::{self, Laws};
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;

/// y'_k = al y'_{k-1} + (1 - al) y_k.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorLag {
    /// The output.
    pub at: Output,
    /// fc, Hz; positive.
    pub corner_hz: f64,
    /// The filter.
    #[serde(default, with = "written")]
    pub law: SensorLagLaw,
}

/// Filters of a slow sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum SensorLagLaw {
    /// One pole at fc.
    #[default]
    OnePole,
    /// Two poles, at (1 + p) fc and (1 + 1 / p) fc. To first order in frequency, they lag as one pole does.
    TwoPoles {
        /// p, their ratio; positive.
        ratio: f64,
    },
}

impl Laws for SensorLagLaw {
    /// Two equal poles are typical of a designed filter. Two poles that are far apart represent a sensor and its
    /// cable, each with a lag of its own. The farther apart they are, the nearer they are to the vocabulary's single
    /// pole.
    const SHAPES: &'static [Shape] = &[Shape {
        law: "two-poles",
        number: "ratio",
        fixed: 1.0,
        ranges: Halves { development: &[[1.0, 1.8]], reported: &[[2.8, 6.0]] },
    }];
}

impl Law for SensorLag {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("corner_hz", self.corner_hz)?;
        match self.law {
            SensorLagLaw::OnePole => Ok(()),
            SensorLagLaw::TwoPoles { ratio } => positive("law.ratio", ratio),
        }
    }

    fn install(&self, site: Site, chain: &mut Chain) {
        let poles = match self.law {
            SensorLagLaw::OnePole => vec![1.0],
            SensorLagLaw::TwoPoles { ratio } => vec![1.0 + ratio, 1.0 + 1.0 / ratio],
        };
        for pole in poles {
            let al = (-2.0 * PI * pole * self.corner_hz / site.clock.sample_rate_hz).exp();
            let mut state = 0.0;
            chain.change_output(self.at.0, move |y, _t| {
                state = al * state + (1.0 - al) * y;
                state
            });
        }
    }

    fn strengthen(&mut self, factor: f64) {
        self.corner_hz /= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.corner_hz]
    }

    fn own_equation(&self) -> bool {
        self.law == SensorLagLaw::OnePole
    }
}

impl Described for SensorLag {
    const FAMILY: Family = Family::LinearSensor;
    const AT: At = At::Output;
    const ON: &'static [On] = &[On::Structure, On::Channels];
    const PARAMETERS: &'static [&'static str] = &["fc"];
    const NEAR_MISSES: &'static [&'static str] = &["two-poles"];
    const SHAPES: &'static [Shape] = SensorLagLaw::SHAPES;
    const IMPERFECTION: bool = true;

    fn start(_draw: &mut Draw<'_>) -> Value {
        json!({ "corner_hz": 600.0 })
    }
}
