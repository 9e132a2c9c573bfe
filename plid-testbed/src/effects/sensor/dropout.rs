//! A line that fails for a few samples: the last good value repeats.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::{finite, not_negative, positive};
use crate::effects::chain::{Chain, Clock, SensorEffect, Site};
use crate::effects::family::{Halves, Shape};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Output;
use crate::effects::written::{self, Laws};
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;
use ndarray::Array2;
use rand::RngExt;
use rand_chacha::ChaCha12Rng;

/// At random instants the last good value repeats for 2 to 8 samples.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorDropout {
    /// The output.
    pub at: Output,
    /// Mean rate of onsets, 1/sample; positive, at most 1.
    pub onsets_per_sample: f64,
    /// The reading during a dropout.
    #[serde(default, with = "written")]
    pub law: DropoutLaw,
}

/// The reading of a line that fails.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum DropoutLaw {
    /// The last good value.
    #[default]
    Hold,
    /// A share of the last good value, by default a half.
    Half {
        /// The share; either sign.
        share: f64,
    },
}

impl Laws for DropoutLaw {
    /// The reading of an open line depends on what discharges the line and how fast: it is nothing (a share of zero),
    /// or most of the last good value. With a share of one, the value is held, as in the vocabulary's law.
    const SHAPES: &'static [Shape] = &[Shape {
        law: "half",
        number: "share",
        fixed: 0.5,
        ranges: Halves { development: &[[0.4, 0.6]], reported: &[[0.0, 0.25], [0.75, 0.85]] },
    }];
}

struct Dropping {
    config: SensorDropout,
    rng: ChaCha12Rng,
}

impl SensorEffect for Dropping {
    fn apply(&mut self, _clock: Clock, y: &mut Array2<f64>) {
        let (mut left, mut held) = (0, 0.0);
        let mut good = 0.0;
        for value in y.column_mut(self.config.at.0) {
            // Both are drawn for every sample, so that a higher rate keeps the onsets of a lower one.
            let (chance, length): (f64, usize) = (self.rng.random(), self.rng.random_range(2..=8));
            if left == 0 && chance < self.config.onsets_per_sample {
                (left, held) = (length, good);
            }
            if left > 0 {
                left -= 1;
                *value = match self.config.law {
                    DropoutLaw::Hold => held,
                    DropoutLaw::Half { share } => held * share,
                };
            } else {
                good = *value;
            }
        }
    }
}

impl Law for SensorDropout {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("onsets_per_sample", self.onsets_per_sample)?;
        not_negative("1 - onsets_per_sample", 1.0 - self.onsets_per_sample)?;
        match self.law {
            DropoutLaw::Hold => Ok(()),
            DropoutLaw::Half { share } => finite("law.share", share),
        }
    }

    fn install(&self, site: Site, chain: &mut Chain) {
        chain.codes.push(Box::new(Dropping { config: self.clone(), rng: site.rng }));
    }

    fn strengthen(&mut self, factor: f64) {
        self.onsets_per_sample = (self.onsets_per_sample * factor).min(1.0);
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.onsets_per_sample]
    }

    fn own_equation(&self) -> bool {
        self.law == DropoutLaw::Hold
    }

    fn foretold(&self) -> bool {
        false
    }
}

impl Described for SensorDropout {
    const FAMILY: Family = Family::NonlinearSensor;
    const AT: At = At::Output;
    const ON: &'static [On] = &[On::Structure];
    const PARAMETERS: &'static [&'static str] = &["rate"];
    const NEAR_MISSES: &'static [&'static str] = &["half"];
    const SHAPES: &'static [Shape] = DropoutLaw::SHAPES;

    fn start(_draw: &mut Draw<'_>) -> Value {
        json!({ "onsets_per_sample": 1e-3 })
    }
}
