//! White noise in addition to the declared noise.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::{not_negative, positive};
use crate::effects::chain::{Chain, Site};
use crate::effects::family::{Halves, Shape};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Output;
use crate::effects::written::{self, Laws};
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;
use rand_distr::{Distribution, StandardNormal};

/// y' = y + white noise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorNoise {
    /// The output.
    pub at: Output,
    /// Standard deviation, V; positive.
    pub rms_v: f64,
    /// The distribution of the noise.
    #[serde(default, with = "written")]
    pub law: NoiseLaw,
}

/// Distributions of noise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum NoiseLaw {
    /// Gaussian.
    #[default]
    Gaussian,
    /// Laplace's distribution, with heavier tails, for a share of the variance, and Gaussian for the rest.
    Laplace {
        /// The share, from zero to one.
        share: f64,
    },
}

impl Laws for NoiseLaw {
    /// A sensor's own noise is Gaussian, and noise from switching nearby comes in bursts; either may prevail. Without
    /// the share with heavy tails, the noise is the vocabulary's.
    const SHAPES: &'static [Shape] = &[Shape {
        law: "laplace",
        number: "share",
        fixed: 1.0,
        ranges: Halves { development: &[[0.8, 1.0]], reported: &[[0.35, 0.65]] },
    }];
}

impl Law for SensorNoise {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("rms_v", self.rms_v)?;
        match self.law {
            NoiseLaw::Gaussian => Ok(()),
            NoiseLaw::Laplace { share } => {
                not_negative("law.share", share)?;
                not_negative("1 - law.share", 1.0 - share)
            }
        }
    }

    fn install(&self, site: Site, chain: &mut Chain) {
        let (rms, law, mut rng) = (self.rms_v, self.law, site.rng);
        chain.change_output(self.at.0, move |y, _t| {
            let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
            y + rms
                * match law {
                    NoiseLaw::Gaussian => normal(),
                    NoiseLaw::Laplace { share } => {
                        // The difference of two products of normal values is Laplace distributed, here with unit
                        // variance.
                        let heavy = (normal() * normal() - normal() * normal()) / 2.0_f64.sqrt();
                        if share < 1.0 { share.sqrt() * heavy + (1.0 - share).sqrt() * normal() } else { heavy }
                    }
                }
        });
    }

    fn strengthen(&mut self, factor: f64) {
        self.rms_v *= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.rms_v]
    }

    fn own_equation(&self) -> bool {
        self.law == NoiseLaw::Gaussian
    }

    fn foretold(&self) -> bool {
        false
    }
}

impl Described for SensorNoise {
    const FAMILY: Family = Family::AddedBySensor;
    const AT: At = At::Output;
    const ON: &'static [On] = &[On::Structure, On::Sensor];
    const PARAMETERS: &'static [&'static str] = &["std"];
    const NEAR_MISSES: &'static [&'static str] = &["laplace"];
    const SHAPES: &'static [Shape] = NoiseLaw::SHAPES;

    fn start(_draw: &mut Draw<'_>) -> Value {
        json!({ "rms_v": 0.02 })
    }
}
