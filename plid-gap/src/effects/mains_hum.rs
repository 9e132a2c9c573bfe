use super::{Action, Effect, Parameter, Place, Range, Sensor, Setting, Side};
use std::f64::consts::{PI, TAU};

/// Hz.
const MAINS: [f64; 2] = [50.0, 60.0];

/// The mains in a sensor line, with its third harmonic.
pub struct MainsHum;

impl Effect for MainsHum {
    fn name(&self) -> &'static str {
        "mains-hum"
    }

    fn side(&self) -> Side {
        Side::Sensor
    }

    fn equation(&self) -> &'static str {
        "y' = y + a sin(2 pi f t + phi) + a3 sin(6 pi f t + phi3)"
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![
            Parameter::new("a", "V", Range::Signed),
            Parameter::new("f", "Hz", Range::Hz),
            Parameter::new("phi", "rad", Range::Angle),
            Parameter::new("a3", "V", Range::Signed),
            Parameter::new("phi3", "rad", Range::Angle),
        ]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.outputs()
    }

    fn starts(&self, setting: &Setting, place: &Place) -> Vec<Vec<f64>> {
        let Place::Output(o) = *place else { return Vec::new() };
        let near =
            |mains: f64| setting.tones.iter().map(|tone| tone.hz).filter(move |hz| (hz / mains - 1.0).abs() < 0.01);
        let hz = MAINS.iter().flat_map(|&mains| near(mains).chain([mains]).take(2));
        let a = 0.02 * setting.y_rms[o];
        hz.flat_map(|hz| [0.0, 0.5].map(|turns| vec![a, hz, turns * PI, 0.01 * a, 0.0])).collect()
    }

    fn amplitude(&self) -> Option<(usize, f64)> {
        Some((0, 0.0))
    }

    fn act(&self, _setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let Place::Output(o) = *place else { return Vec::new() };
        let [a, f, phi, a3, phi3] = [0, 1, 2, 3, 4].map(|k| parameters[k]);
        vec![Action::Sensor(Box::new(Hum { o, a, f, phi, a3, phi3 }))]
    }
}

struct Hum {
    o: usize,
    a: f64,
    f: f64,
    phi: f64,
    a3: f64,
    phi3: f64,
}

impl Sensor for Hum {
    fn apply(&self, y: &mut [Vec<f64>], t0: f64, rate: f64) {
        for (k, y) in y[self.o].iter_mut().enumerate() {
            let t = t0 + k as f64 / rate;
            *y += self.a * (TAU * self.f * t + self.phi).sin() + self.a3 * (3.0 * TAU * self.f * t + self.phi3).sin();
        }
    }
}
