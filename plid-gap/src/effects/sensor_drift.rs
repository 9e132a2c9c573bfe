use super::{Action, Effect, Flexible, Memory, Parameter, Place, Range, Sampling, Sensor, Setting, Side};

/// A sensor whose offset changes with time.
pub struct SensorDrift;

impl Effect for SensorDrift {
    fn name(&self) -> &'static str {
        "sensor-drift"
    }

    fn side(&self) -> Side {
        Side::Sensor
    }

    fn equation(&self) -> &'static str {
        "y' = y + s t"
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("s", "V/s", Range::Signed)]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.outputs()
    }

    fn starts(&self, setting: &Setting, place: &Place) -> Vec<Vec<f64>> {
        let Place::Output(o) = *place else { return Vec::new() };
        vec![vec![0.02 * setting.y_rms[o] / setting.duration_s]]
    }

    fn amplitude(&self) -> Option<(usize, f64)> {
        Some((0, 0.0))
    }

    fn free_shape(&self) -> Option<&'static Flexible> {
        Some(&Flexible::ZeroCourse)
    }

    fn act(&self, _setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let Place::Output(o) = *place else { return Vec::new() };
        vec![Action::Sensor(Box::new(Drift { o, s: parameters[0] }))]
    }
}

struct Drift {
    o: usize,
    s: f64,
}

impl Sensor for Drift {
    fn apply(&self, y: &mut [Vec<f64>], sampling: Sampling, _memory: &mut Memory) {
        for (k, y) in y[self.o].iter_mut().enumerate() {
            *y += self.s * sampling.time(k);
        }
    }
}
