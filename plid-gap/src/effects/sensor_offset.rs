use super::{Action, Effect, Memory, Parameter, Place, Range, Sampling, Sensor, Setting, Side};

/// A sensor that does not read zero at rest.
pub struct SensorOffset;

impl Effect for SensorOffset {
    fn name(&self) -> &'static str {
        "sensor-offset"
    }

    fn side(&self) -> Side {
        Side::Sensor
    }

    fn equation(&self) -> &'static str {
        "y' = y + o"
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("o", "V", Range::Signed)]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.outputs()
    }

    fn starts(&self, setting: &Setting, place: &Place) -> Vec<Vec<f64>> {
        let Place::Output(o) = *place else { return Vec::new() };
        vec![vec![0.01 * setting.y_rms[o]]]
    }

    fn amplitude(&self) -> Option<(usize, f64)> {
        Some((0, 0.0))
    }

    fn act(&self, _setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let Place::Output(o) = *place else { return Vec::new() };
        vec![Action::Sensor(Box::new(Offset { o, offset: parameters[0] }))]
    }
}

struct Offset {
    o: usize,
    offset: f64,
}

impl Sensor for Offset {
    fn apply(&self, y: &mut [Vec<f64>], _sampling: Sampling, _memory: &mut Memory) {
        for y in &mut y[self.o] {
            *y += self.offset;
        }
    }
}
