//! A spring that is in contact only part of the time, at random: f = -k s(t) d with s a random telegraph signal.

use rand::RngExt;
use rand_chacha::ChaCha12Rng;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::positive;
use crate::effects::chain::{Chain, Site, StructureEffect, add_scaled, dot};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Input;
use crate::effects::{At, Described, Draw, Family, Half, On};
use crate::error::TestbedError;
use crate::plant::StrutPort;

/// f = -k s(t) d, where s is 0 or 1, each for an exponentially distributed time of mean T.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IntermittentContact {
    /// The input at whose strut it acts.
    pub at: Input,
    /// k, V/V; positive.
    pub stiffness: f64,
    /// T, s; positive.
    pub mean_s: f64,
}

struct Touching {
    port: StrutPort,
    stiffness: f64,
    mean_s: f64,
    touches: bool,
    rng: ChaCha12Rng,
}

impl StructureEffect for Touching {
    fn add_rate(&self, _t_s: f64, x: &[f64], rate: &mut [f64]) {
        if self.touches {
            add_scaled(rate, &self.port.force, -self.stiffness * dot(&self.port.displacement, x));
        }
    }

    fn end_step(&mut self, h_s: f64, _x: &[f64]) {
        // The probability that the step contains an odd number of changes.
        let other = (1.0 - (-2.0 * h_s / self.mean_s).exp()) / 2.0;
        self.touches ^= self.rng.random::<f64>() < other;
    }
}

impl Law for IntermittentContact {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("stiffness", self.stiffness)?;
        positive("mean_s", self.mean_s)
    }

    fn install(&self, site: Site, chain: &mut Chain) {
        let (port, mut rng) = (site.truss.ports[self.at.0].clone(), site.rng);
        let touches = rng.random();
        let (stiffness, mean_s) = (self.stiffness, self.mean_s);
        chain.structure.push(Box::new(Touching { port, stiffness, mean_s, touches, rng }));
    }

    fn strengthen(&mut self, factor: f64) {
        self.stiffness *= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.stiffness, self.mean_s]
    }

    fn foretold(&self) -> bool {
        false
    }
}

impl Described for IntermittentContact {
    const FAMILY: Family = Family::Outside(Half::Reported);
    const AT: At = At::Port;
    const ON: &'static [On] = &[On::Structure];

    fn start(draw: &mut Draw<'_>) -> Value {
        json!({ "stiffness": 0.01, "mean_s": draw.within(0.02..0.2) })
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;

    /// The contact is a linear spring or nothing, half of the time each, and its autocorrelation is exp(-2 t / T).
    #[test]
    fn contact_is_a_random_telegraph_signal() {
        let port = StrutPort { input: 0, force: vec![0.0, 2.0], displacement: vec![3.0, 0.0], velocity: vec![0.0; 2] };
        let rng = ChaCha12Rng::seed_from_u64(1);
        let mut spring = Touching { port, stiffness: 0.5, mean_s: 0.05, touches: true, rng };
        let h_s = 1e-3;
        let signs: Vec<f64> = (0..400_000)
            .map(|_| {
                let mut rate = [0.0; 2];
                spring.add_rate(0.0, &[0.1, 7.0], &mut rate);
                spring.end_step(h_s, &[0.1, 7.0]);
                // 2 times -0.5 times 3 times 0.1.
                assert!(rate[0] == 0.0 && (rate[1] == 0.0 || (rate[1] + 0.3).abs() < 1e-15), "{rate:?}");
                if rate[1] == 0.0 { -1.0 } else { 1.0 }
            })
            .collect();
        let mean = signs.iter().sum::<f64>() / signs.len() as f64;
        assert!(mean.abs() < 0.05, "{mean}");
        for lag in [5, 20, 50] {
            let found = signs.iter().zip(&signs[lag..]).map(|(a, b)| a * b).sum::<f64>() / signs.len() as f64;
            let expected = (-2.0 * lag as f64 * h_s / 0.05).exp();
            assert!((found - expected).abs() < 0.04, "{found}, not {expected}");
        }
    }
}
