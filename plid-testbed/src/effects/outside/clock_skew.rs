//! A converter whose own clock runs fast: y'(t_k) = y((1 - e) t_k).

use ndarray::Array2;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::positive;
use crate::effects::chain::{Chain, Clock, SensorEffect, Site};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Output;
use crate::effects::sensor::{LOOK_AHEAD, band_limited};
use crate::effects::{At, Described, Draw, Family, Half, On};
use crate::error::TestbedError;

/// y'(t_k) = y((1 - e) t_k), where t_k is the time since the record began. The channel is triggered with the others,
/// and takes each sample earlier than they do, by a time that grows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClockSkew {
    /// The output.
    pub at: Output,
    /// e, share by which the clock is fast; positive, below 0.1.
    pub fast_share: f64,
}

impl SensorEffect for ClockSkew {
    fn apply(&mut self, _clock: Clock, y: &mut Array2<f64>) {
        let before = y.column(self.at.0).to_vec();
        for (k, value) in y.column_mut(self.at.0).iter_mut().enumerate() {
            *value = band_limited(&before, k, self.fast_share * k as f64);
        }
    }
}

impl Law for ClockSkew {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("fast_share", self.fast_share)?;
        positive("0.1 - fast_share", 0.1 - self.fast_share)
    }

    fn install(&self, _site: Site, chain: &mut Chain) {
        chain.look_ahead = chain.look_ahead.max(LOOK_AHEAD);
        chain.sensor.push(Box::new(self.clone()));
    }

    fn strengthen(&mut self, factor: f64) {
        self.fast_share *= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.fast_share]
    }
}

impl Described for ClockSkew {
    const FAMILY: Family = Family::Outside(Half::Reported);
    const AT: At = At::Output;
    const ON: &'static [On] = &[On::Structure];

    fn start(_draw: &mut Draw<'_>) -> Value {
        json!({ "fast_share": 1e-4 })
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    /// A sine that is sampled by a fast clock appears as a sine of a lower frequency, with the same phase at the
    /// start.
    #[test]
    fn a_fast_clock_lowers_the_frequency() {
        let (f, fast) = (0.13, 0.003);
        let sine = |f: f64, k: usize| (2.0 * PI * f * k as f64 + 0.3).sin();
        let mut y = Array2::from_shape_fn((1500, 3), |(k, _)| sine(f, k));
        ClockSkew { at: Output(1), fast_share: fast }
            .apply(Clock { record: 0, start: 700, sample_rate_hz: 1.0 }, &mut y);
        for k in 60..1450 {
            let error = y[(k, 1)] - sine(f * (1.0 - fast), k);
            assert!(error.abs() < 1e-4, "{error} at {k}");
            assert_eq!(y[(k, 0)], sine(f, k));
        }
        // After 1000 samples, the channel lags by three of them.
        assert!((y[(1000, 1)] - sine(f, 1000)).abs() > 0.1);
    }
}
