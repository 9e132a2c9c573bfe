//! A band of noise that shakes the structure: stationary, and different in every record.

use std::f64::consts::PI;

use rand_chacha::ChaCha12Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::positive;
use crate::effects::chain::{Chain, Disturbance, Site};
use crate::effects::family::Halves;
use crate::effects::law::{Law, Limits};
use crate::effects::place::Input;
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;

/// Band-pass noise as a force along a strut.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ColouredDisturbance {
    /// The input along whose strut it acts.
    pub at: Input,
    /// Standard deviation, V; positive.
    pub rms_v: f64,
    /// Centre, Hz; below half the sample rate.
    pub frequency_hz: f64,
    /// Width of the band at half its power, as a share of the centre.
    #[serde(default = "tenth")]
    pub relative_width: f64,
}

fn tenth() -> f64 {
    0.1
}

/// f_k = 2 r cos(w) f_{k-1} - r^2 f_{k-2} + e_k, started from its stationary distribution.
struct Band {
    rng: ChaCha12Rng,
    coefficients: [f64; 2],
    innovation: f64,
    last: [f64; 2],
}

impl Band {
    fn new(config: &ColouredDisturbance, sample_rate_hz: f64, mut rng: ChaCha12Rng) -> Self {
        let step = PI / sample_rate_hz;
        let r = (-step * config.relative_width * config.frequency_hz).exp();
        let [a1, a2] = [2.0 * r * (2.0 * step * config.frequency_hz).cos(), -r * r];
        // For a stationary second-order process: its first autocorrelation, and the innovation that gives unit
        // variance.
        let correlation = a1 / (1.0 - a2);
        let innovation = ((1.0 + a2) * ((1.0 - a2).powi(2) - a1 * a1) / (1.0 - a2)).sqrt();
        let (first, second): (f64, f64) = (StandardNormal.sample(&mut rng), StandardNormal.sample(&mut rng));
        let next = correlation * first + (1.0 - correlation * correlation).sqrt() * second;
        let std = config.rms_v;
        Self { rng, coefficients: [a1, a2], innovation: std * innovation, last: [std * next, std * first] }
    }
}

impl Disturbance for Band {
    fn force(&mut self, _t_s: f64) -> f64 {
        let draw: f64 = StandardNormal.sample(&mut self.rng);
        let [a1, a2] = self.coefficients;
        let force = a1 * self.last[0] + a2 * self.last[1] + self.innovation * draw;
        self.last = [force, self.last[0]];
        force
    }
}

impl Law for ColouredDisturbance {
    fn check(&self, limits: &Limits) -> Result<(), TestbedError> {
        positive("rms_v", self.rms_v)?;
        positive("frequency_hz", self.frequency_hz)?;
        positive("relative_width", self.relative_width)?;
        let nyquist_hz = limits.sample_rate_hz / 2.0;
        if self.frequency_hz < nyquist_hz {
            return Ok(());
        }
        Err(TestbedError::AboveNyquist { key: "frequency_hz", value: self.frequency_hz, nyquist_hz })
    }

    fn install(&self, site: Site, chain: &mut Chain) {
        chain.forces.push((self.at.0, Box::new(Band::new(self, site.clock.sample_rate_hz, site.rng))));
    }

    fn strengthen(&mut self, factor: f64) {
        self.rms_v *= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.rms_v, self.frequency_hz]
    }

    fn foretold(&self) -> bool {
        false
    }
}

/// Relative widths from which one is drawn, if the width is not fixed at a tenth. They range from a rotor whose speed
/// varies by a few per cent to a flow with broadband turbulence.
const WIDTHS: Halves<[f64; 2]> = Halves { development: &[[0.07, 0.15]], reported: &[[0.03, 0.05], [0.2, 0.35]] };

impl Described for ColouredDisturbance {
    const FAMILY: Family = Family::Disturbance;
    const AT: At = At::Disturbance;
    const ON: &'static [On] = &[On::Structure];
    const PARAMETERS: &'static [&'static str] = &["a", "f"];
    const IMPERFECTION: bool = true;

    fn start(draw: &mut Draw<'_>) -> Value {
        let frequency_hz = draw.within(80.0..240.0);
        let relative_width = draw.families.number(&WIDTHS, draw.rng).unwrap_or_else(tenth);
        json!({ "rms_v": 0.1, "frequency_hz": frequency_hz, "relative_width": relative_width })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn the_band_is_stationary_from_its_first_value_and_peaks_at_its_centre() {
        let config = ColouredDisturbance { at: Input(0), rms_v: 0.3, frequency_hz: 120.0, relative_width: 0.1 };
        let (mut first, mut late, mut product) = (0.0, 0.0, 0.0);
        let runs = 4000;
        for seed in 0..runs {
            let mut band = Band::new(&config, 1600.0, ChaCha12Rng::seed_from_u64(seed));
            let values: Vec<f64> = (0..60).map(|_| band.force(0.0)).collect();
            first += values[0] * values[0];
            late += values[59] * values[59];
            // The two values are 0.15 of a period apart.
            product += values[40] * values[42];
        }
        let [first, late, product] = [first, late, product].map(|sum| sum / runs as f64 / 0.09);
        assert!((first - 1.0).abs() < 0.08 && (late - 1.0).abs() < 0.08, "{first} {late}");
        let expected = (2.0 * PI * 120.0 * 2.0 / 1600.0).cos();
        assert!((product - expected).abs() < 0.08, "{product}, {expected}");
    }
}
