//! A channel that is sampled late: y'(t_k) = y(t_k - tau), with linear phase on the samples.

use std::f64::consts::PI;

use ndarray::Array2;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::positive;
use crate::effects::chain::{Chain, Clock, SensorEffect, Site};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Output;
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;

/// y'(t_k) = y(t_k - tau).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorDelay {
    /// The output.
    pub at: Output,
    /// tau, samples; positive, at most 1000.
    pub delay_samples: f64,
    /// The value between samples.
    #[serde(default)]
    pub law: SensorDelayLaw,
}

/// Values between samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SensorDelayLaw {
    /// That of the band-limited signal: linear phase.
    #[default]
    BandLimited,
    /// On the line between two samples, which also smooths.
    Interpolated,
}

/// Samples each side that give a band-limited value.
pub(crate) const LOOK_AHEAD: usize = 48;
/// Shape of Kaiser's window (1974): errors below 1e-4 at 0.9 of half the sample rate, below 2e-6 at 0.4 of it.
const BETA: f64 = 10.0;

impl SensorEffect for SensorDelay {
    fn apply(&mut self, _clock: Clock, y: &mut Array2<f64>) {
        let whole = self.delay_samples.floor();
        let taps = taps(self.law, self.delay_samples - whole);
        let before = y.column(self.at.0).to_vec();
        for (k, value) in y.column_mut(self.at.0).iter_mut().enumerate() {
            *value = weighted(&before, k as i64 - whole as i64, &taps);
        }
    }
}

/// Returns the value of a band-limited signal `delay` samples before sample `k`. It takes [`LOOK_AHEAD`] samples each
/// side; before and after the signal they are zero.
pub(crate) fn band_limited(signal: &[f64], k: usize, delay: f64) -> f64 {
    let whole = delay.floor();
    weighted(signal, k as i64 - whole as i64, &taps(SensorDelayLaw::BandLimited, delay - whole))
}

/// The sum of the samples at `k` + offset, each times its weight.
fn weighted(signal: &[f64], k: i64, taps: &[(i64, f64)]) -> f64 {
    let term = |(offset, tap): &(i64, f64)| {
        let index = usize::try_from(k + *offset).ok()?;
        signal.get(index).map(|y| tap * y)
    };
    taps.iter().filter_map(term).sum()
}

/// Weights of the samples at k + offset that give the value at k - `share`.
fn taps(law: SensorDelayLaw, share: f64) -> Vec<(i64, f64)> {
    if law == SensorDelayLaw::Interpolated || share == 0.0 {
        return vec![(0, 1.0 - share), (-1, share)];
    }
    let (half, unit) = (LOOK_AHEAD as i64, bessel_i0(BETA));
    (-half..half)
        .map(|offset| {
            let x = offset as f64 + share;
            let window = bessel_i0(BETA * (1.0 - (x / LOOK_AHEAD as f64).powi(2)).max(0.0).sqrt()) / unit;
            (offset, (PI * x).sin() / (PI * x) * window)
        })
        .collect()
}

/// The modified Bessel function of order zero, by its series.
fn bessel_i0(x: f64) -> f64 {
    let quarter = x * x / 4.0;
    let (mut sum, mut term) = (1.0, 1.0);
    for k in 1..60 {
        term *= quarter / f64::from(k * k);
        sum += term;
        // Later terms would change no digit.
        if term < 1e-17 * sum {
            break;
        }
    }
    sum
}

impl Law for SensorDelay {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("delay_samples", self.delay_samples)?;
        positive("1000 - delay_samples", 1000.0 - self.delay_samples)
    }

    fn install(&self, _site: Site, chain: &mut Chain) {
        chain.look_ahead = chain.look_ahead.max(LOOK_AHEAD);
        chain.sensor.push(Box::new(self.clone()));
    }

    fn strengthen(&mut self, factor: f64) {
        self.delay_samples *= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.delay_samples]
    }

    fn own_equation(&self) -> bool {
        self.law == SensorDelayLaw::BandLimited
    }
}

impl Described for SensorDelay {
    const FAMILY: Family = Family::LinearSensor;
    const AT: At = At::Output;
    const ON: &'static [On] = &[On::Structure, On::Channels];
    const PARAMETERS: &'static [&'static str] = &["tau"];
    const NEAR_MISSES: &'static [&'static str] = &["interpolated"];
    const IMPERFECTION: bool = true;

    fn start(_draw: &mut Draw<'_>) -> Value {
        json!({ "delay_samples": 0.3 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sine_is_delayed_exactly_in_phase() {
        for (f, bound) in [(0.01, 1e-5), (0.2, 2e-6), (0.45, 1e-4)] {
            for tau in [0.25, 0.5, 2.75] {
                let sine = |t: f64| (2.0 * PI * f * t + 0.3).sin();
                let mut y = Array2::from_shape_fn((300, 3), |(k, _)| sine(k as f64));
                let mut delay = SensorDelay { at: Output(1), delay_samples: tau, law: SensorDelayLaw::BandLimited };
                delay.apply(Clock { record: 0, start: 0, sample_rate_hz: 1.0 }, &mut y);
                for k in 100..200 {
                    let error = y[(k, 1)] - sine(k as f64 - tau);
                    assert!(error.abs() < bound, "{error} at {f}, {tau}");
                    assert_eq!(y[(k, 0)], sine(k as f64));
                }
            }
        }
    }
}
