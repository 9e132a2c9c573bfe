//! A sensor whose noise grows with its signal: y' = y (1 + s n).

use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::positive;
use crate::effects::chain::{Chain, Site};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Output;
use crate::effects::{At, Described, Draw, Family, Half, On};
use crate::error::TestbedError;

/// y' = y (1 + s n), where n is white and Gaussian with unit variance.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProportionalNoise {
    /// The output.
    pub at: Output,
    /// s, standard deviation of the noise relative to the signal; positive.
    pub share: f64,
}

impl Law for ProportionalNoise {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("share", self.share)
    }

    fn install(&self, site: Site, chain: &mut Chain) {
        let (share, mut rng) = (self.share, site.rng);
        chain.change_output(self.at.0, move |y, _t| {
            let n: f64 = StandardNormal.sample(&mut rng);
            y * (1.0 + share * n)
        });
    }

    fn strengthen(&mut self, factor: f64) {
        self.share *= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.share]
    }

    fn foretold(&self) -> bool {
        false
    }
}

impl Described for ProportionalNoise {
    const FAMILY: Family = Family::Outside(Half::Reported);
    const AT: At = At::Output;
    const ON: &'static [On] = &[On::Structure, On::Sensor];

    fn start(_draw: &mut Draw<'_>) -> Value {
        json!({ "share": 0.1 })
    }
}
