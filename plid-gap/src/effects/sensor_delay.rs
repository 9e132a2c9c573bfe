use super::{Action, Effect, Flexible, Parameter, Place, Range, Sensor, Setting, Side};
use std::f64::consts::TAU;

use plid_fourier::C;

/// A delay of an output.
pub struct SensorDelay;

impl Effect for SensorDelay {
    fn name(&self) -> &'static str {
        "sensor-delay"
    }

    fn side(&self) -> Side {
        Side::Sensor
    }

    fn family(&self) -> Option<&'static str> {
        Some("a delayed measurement")
    }

    fn equation(&self) -> &'static str {
        "y'(t_k) = y(t_k - tau)"
    }

    fn is_linear(&self) -> bool {
        true
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("tau", "samples", Range::Positive)]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.outputs()
    }

    fn starts(&self, _setting: &Setting, _place: &Place) -> Vec<Vec<f64>> {
        [0.1, 0.5, 1.5, 4.0, 10.0].map(|samples| vec![samples]).to_vec()
    }

    fn free_shape(&self) -> Option<&'static Flexible> {
        Some(&Flexible::SensorPath)
    }

    fn act(&self, _setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let Place::Output(o) = *place else { return Vec::new() };
        vec![Action::Sensor(Box::new(Delay { o, tau: parameters[0] }))]
    }
}

struct Delay {
    o: usize,
    tau: f64,
}

impl Sensor for Delay {
    fn apply(&self, y: &mut [Vec<f64>], _t0: f64, _rate: f64) {
        delay(&mut y[self.o], self.tau);
    }
}

/// Delays a channel by any number of samples, with linear phase over the whole band; zero before the record.
fn delay(y: &mut [f64], samples: f64) {
    let length = plid_fourier::good_length(y.len() + samples.ceil() as usize + 64);
    let mut padded = y.to_vec();
    padded.resize(length, 0.0);
    let mut spectrum = plid_fourier::forward(&padded);
    for (k, bin) in spectrum.iter_mut().enumerate() {
        *bin *= C::cis(-TAU * k as f64 * samples / length as f64);
    }
    let delayed = plid_fourier::backward(&spectrum, length);
    y.copy_from_slice(&delayed[..y.len()]);
}
