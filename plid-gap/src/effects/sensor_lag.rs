use super::{Action, Effect, Flexible, Memory, Parameter, Place, Range, Sampling, Sensor, Setting, Side};
use std::f64::consts::TAU;

/// A sensor with a low-pass filter that the simulation lacks.
pub struct SensorLag;

impl Effect for SensorLag {
    fn name(&self) -> &'static str {
        "sensor-lag"
    }

    fn side(&self) -> Side {
        Side::Sensor
    }

    fn family(&self) -> Option<&'static str> {
        Some("a delayed measurement")
    }

    fn equation(&self) -> &'static str {
        "y'_k = al y'_{k-1} + (1 - al) y_k, al = exp(-2 pi fc / fs)"
    }

    fn is_linear(&self) -> bool {
        true
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("fc", "Hz", Range::Positive)]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.outputs()
    }

    fn starts(&self, setting: &Setting, _place: &Place) -> Vec<Vec<f64>> {
        [0.06, 0.2, 0.45].map(|share| vec![share * setting.plant.rate]).to_vec()
    }

    fn free_shape(&self) -> Option<&'static Flexible> {
        Some(&Flexible::SensorPath)
    }

    fn act(&self, _setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let Place::Output(o) = *place else { return Vec::new() };
        vec![Action::Sensor(Box::new(Lag { o, fc: parameters[0] }))]
    }
}

struct Lag {
    o: usize,
    fc: f64,
}

impl Sensor for Lag {
    fn apply(&self, y: &mut [Vec<f64>], sampling: Sampling, memory: &mut Memory) {
        let al = (-TAU * self.fc / sampling.rate).exp();
        let [lagged] = memory.values([sampling.before(&y[self.o])]);
        for y in &mut y[self.o] {
            *lagged = al * *lagged + (1.0 - al) * *y;
            *y = *lagged;
        }
    }
}
