//! A sensor that the motion of another axis shakes through the resonance of the sensor's mount.

use std::f64::consts::PI;

use ndarray::Array2;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::{finite, positive};
use crate::effects::chain::{Chain, Clock, SensorEffect, Site};
use crate::effects::law::{Law, Limits};
use crate::effects::place::OutputPair;
use crate::effects::{At, Described, Draw, Family, Half, On};
use crate::error::TestbedError;

/// y'_i = y_i + c r with r" + 2 z w r' + w^2 r = w^2 y_j, where the samples of y_j are held.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ResonantCrosstalk {
    /// From the output j into the output i.
    pub at: OutputPair,
    /// c; either sign.
    pub share: f64,
    /// w / (2 pi), Hz; below half the sample rate.
    pub frequency_hz: f64,
    /// z; positive, below 1.
    pub damping_ratio: f64,
}

impl SensorEffect for ResonantCrosstalk {
    fn apply(&mut self, clock: Clock, y: &mut Array2<f64>) {
        let h = 1.0 / clock.sample_rate_hz;
        let w = 2.0 * PI * self.frequency_hz;
        let decay = self.damping_ratio * w;
        let ringing = (w * w - decay * decay).sqrt();
        let (sin, cos) = (ringing * h).sin_cos();
        let (sin, shrunk) = (sin / ringing, (-decay * h).exp());
        let (mut r, mut rate) = (0.0, 0.0);
        let OutputPair(from, to) = self.at;
        for mut sample in y.rows_mut() {
            let driven = sample[from];
            sample[to] += self.share * r;
            // About the held value, the motion is free.
            let off = r - driven;
            r = driven + shrunk * ((cos + decay * sin) * off + sin * rate);
            rate = shrunk * ((cos - decay * sin) * rate - w * w * sin * off);
        }
    }
}

impl Law for ResonantCrosstalk {
    fn check(&self, limits: &Limits) -> Result<(), TestbedError> {
        finite("share", self.share)?;
        positive("frequency_hz", self.frequency_hz)?;
        positive("sample_rate_hz / 2 - frequency_hz", limits.sample_rate_hz / 2.0 - self.frequency_hz)?;
        positive("damping_ratio", self.damping_ratio)?;
        positive("1 - damping_ratio", 1.0 - self.damping_ratio)
    }

    fn install(&self, _site: Site, chain: &mut Chain) {
        chain.sensor.push(Box::new(self.clone()));
    }

    fn strengthen(&mut self, factor: f64) {
        self.share *= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.share, self.at.1 as f64, self.frequency_hz, self.damping_ratio]
    }
}

impl Described for ResonantCrosstalk {
    const FAMILY: Family = Family::Outside(Half::Reported);
    const AT: At = At::OutputPair;
    const ON: &'static [On] = &[On::Structure];

    fn start(draw: &mut Draw<'_>) -> Value {
        json!({
            "share": draw.sign * 0.05,
            "frequency_hz": draw.within(80.0..240.0),
            "damping_ratio": draw.within(0.02..0.1),
        })
    }
}
