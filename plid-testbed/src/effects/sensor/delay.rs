//! A channel with a delay: y'(t_k) = y(t_k - tau), with linear phase on the samples.

use std::f64::consts::PI;

use ndarray::Array2;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::{not_negative, positive};
use crate::effects::chain::{Chain, Clock, SensorEffect, Site};
use crate::effects::family::{Halves, Shape};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Output;
use crate::effects::written::{self, Laws};
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
    /// The law of the values between samples.
    #[serde(default, with = "written")]
    pub law: SensorDelayLaw,
}

/// Laws of the values between samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum SensorDelayLaw {
    /// The value of the band-limited signal: linear phase.
    #[default]
    BandLimited,
    /// The output of the filter (b + c / z) / (1 - p / z) that has the gain 1 and delays by the fraction tau of a
    /// sample at low frequencies, with p = -a (1 - tau) / (1 + tau).
    Interpolated {
        /// a, from -1 to 1. At 0, the filter interpolates linearly between two samples, which also smooths. At 1, it
        /// is J.-P. Thiran's all-pass filter (1971). Below 0, it smooths and has a tail as a lag does.
        all_pass: f64,
    },
}

impl Laws for SensorDelayLaw {
    /// Every first-order filter that delays by a fraction of a sample is one of these, and none amplifies as long as
    /// -1 <= a <= 1. At low frequencies, all of them equal the vocabulary's delay.
    const SHAPES: &'static [Shape] = &[Shape {
        law: "interpolated",
        number: "all_pass",
        fixed: 0.0,
        ranges: Halves { development: &[[-0.15, 0.25]], reported: &[[-0.8, -0.4], [0.5, 1.0]] },
    }];
}

/// Number of samples on each side from which a band-limited value is computed.
pub(crate) const LOOK_AHEAD: usize = 48;
/// Shape of Kaiser's window (1974): the errors are below 1e-4 at 0.9 of half the sample rate, and below 2e-6 at 0.4
/// of it.
const BETA: f64 = 10.0;

impl SensorEffect for SensorDelay {
    fn apply(&mut self, _clock: Clock, y: &mut Array2<f64>) {
        let whole = self.delay_samples.floor();
        let share = self.delay_samples - whole;
        let (taps, pole) = match self.law {
            SensorDelayLaw::BandLimited => (band_limited_taps(share), 0.0),
            SensorDelayLaw::Interpolated { all_pass } => first_order(share, all_pass),
        };
        let before = y.column(self.at.0).to_vec();
        let mut last = 0.0;
        for (k, value) in y.column_mut(self.at.0).iter_mut().enumerate() {
            last = pole * last + weighted(&before, k as i64 - whole as i64, &taps);
            *value = last;
        }
    }
}

/// Returns the value of a band-limited signal `delay` samples before sample `k`. It uses [`LOOK_AHEAD`] samples on
/// each side. Beyond the ends of the signal, the samples are zero.
pub(crate) fn band_limited(signal: &[f64], k: usize, delay: f64) -> f64 {
    let whole = delay.floor();
    weighted(signal, k as i64 - whole as i64, &band_limited_taps(delay - whole))
}

/// Returns the sum of the samples at `k` + offset, each multiplied by its weight.
fn weighted(signal: &[f64], k: i64, taps: &[(i64, f64)]) -> f64 {
    let term = |(offset, tap): &(i64, f64)| {
        let index = usize::try_from(k + *offset).ok()?;
        signal.get(index).map(|y| tap * y)
    };
    taps.iter().filter_map(term).sum()
}

/// Returns the weights of two samples and the pole of the first-order filter that delays by a share of a sample.
fn first_order(share: f64, all_pass: f64) -> (Vec<(i64, f64)>, f64) {
    let pole = -all_pass * (1.0 - share) / (1.0 + share);
    let earlier = (1.0 - pole) * share - pole;
    (vec![(0, 1.0 - pole - earlier), (-1, earlier)], pole)
}

/// Returns the weights of the samples at k + offset that give the value at k - `share`.
fn band_limited_taps(share: f64) -> Vec<(i64, f64)> {
    if share == 0.0 {
        return vec![(0, 1.0)];
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

/// Computes the modified Bessel function of order zero by its series.
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
        positive("1000 - delay_samples", 1000.0 - self.delay_samples)?;
        match self.law {
            SensorDelayLaw::BandLimited => Ok(()),
            SensorDelayLaw::Interpolated { all_pass } => not_negative("1 - |law.all_pass|", 1.0 - all_pass.abs()),
        }
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
    const SHAPES: &'static [Shape] = SensorDelayLaw::SHAPES;
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

    /// Returns the gain and the delay in samples of a filter of the family, at a frequency in cycles per sample.
    fn response(delay_samples: f64, all_pass: f64, f: f64) -> (f64, f64) {
        let law = SensorDelayLaw::Interpolated { all_pass };
        let phase = |t: f64| 2.0 * PI * f * t;
        // A cosine and a sine.
        let mut y = Array2::from_shape_fn((3000, 2), |(k, part)| (phase(k as f64) - PI / 2.0 * part as f64).cos());
        for at in [Output(0), Output(1)] {
            SensorDelay { at, delay_samples, law }.apply(Clock { record: 0, start: 0, sample_rate_hz: 1.0 }, &mut y);
        }
        let (re, im) = (y[(2999, 0)], y[(2999, 1)]);
        let late = (phase(2999.0) - im.atan2(re)).rem_euclid(2.0 * PI) / (2.0 * PI * f);
        (re.hypot(im), late)
    }

    /// All filters equal the vocabulary's delay at low frequencies, none amplifies, and that at a = 1 is an all-pass
    /// filter.
    #[test]
    fn filters_of_first_order_delay_what_is_slow() {
        for (tau, all_pass) in [0.3, 0.9, 2.6].into_iter().flat_map(|tau| [-0.8, 0.0, 0.5, 1.0].map(|a| (tau, a))) {
            let (gain, late) = response(tau, all_pass, 0.003);
            assert!((gain - 1.0).abs() < 1e-3 && (late - tau).abs() < 1e-3, "{tau}, {all_pass}: {gain}, {late}");
            let gains = [0.1, 0.2, 0.3, 0.45].map(|f| response(tau, all_pass, f).0);
            assert!(gains.iter().all(|gain| *gain < 1.0 + 1e-9), "{tau}, {all_pass}: {gains:?}");
            assert!(all_pass < 1.0 || gains.iter().all(|gain| *gain > 1.0 - 1e-9), "{tau}: {gains:?}");
        }
        let (on_the_line, _) = response(0.5, 0.0, 0.3);
        assert!((on_the_line - (0.3 * PI).cos()).abs() < 1e-9, "{on_the_line}");
    }
}
