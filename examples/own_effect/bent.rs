//! A sensor with a quadratic characteristic, an effect that the vocabulary lacks.
//!
//! The example diagnoses it, and a test of the blind trials draws it. It takes the names of the library from the parent
//! module, so that it can be compiled with `plid` and with `plid-gap`.

use super::{Action, Effect, Flexible, Memory, Parameter, Place, Range, Sampling, Sensor, Setting, Side};

/// The equation y' = y + c y^2 at one output.
pub struct BentSensor;

impl Effect for BentSensor {
    fn name(&self) -> &'static str {
        "bent-sensor"
    }

    fn side(&self) -> Side {
        Side::Sensor
    }

    fn equation(&self) -> &'static str {
        "y' = y + c y^2"
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("c", "1/V", Range::Signed)]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.outputs()
    }

    /// Returns an initial size, at which the deviation is one per cent of the signal.
    fn starts(&self, setting: &Setting, place: &Place) -> Vec<Vec<f64>> {
        let Place::Output(o) = *place else { return Vec::new() };
        vec![vec![0.01 / setting.y_rms[o]]]
    }

    /// The output is linear in c, so the screen can estimate its size.
    fn amplitude(&self) -> Option<(usize, f64)> {
        Some((0, 0.0))
    }

    /// Returns a free static characteristic of an output, for the case in which the quadratic law does not fit.
    fn free_shape(&self) -> Option<&'static Flexible> {
        Some(&Flexible::Sensor)
    }

    fn act(&self, _setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let Place::Output(o) = *place else { return Vec::new() };
        vec![Action::Sensor(Box::new(Bend { o, c: parameters[0] }))]
    }
}

struct Bend {
    o: usize,
    c: f64,
}

impl Sensor for Bend {
    fn apply(&self, y: &mut [Vec<f64>], _sampling: Sampling, _memory: &mut Memory) {
        for y in &mut y[self.o] {
            *y += self.c * *y * *y;
        }
    }
}
