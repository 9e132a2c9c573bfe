use super::{Action, Effect, Flexible, Parameter, Place, Range, Sensor, Setting, Side};

/// A sensor or an amplifier that clips.
pub struct SensorSaturation;

impl Effect for SensorSaturation {
    fn name(&self) -> &'static str {
        "sensor-saturation"
    }

    fn side(&self) -> Side {
        Side::Sensor
    }

    fn equation(&self) -> &'static str {
        "y' = min(max(y, -a), a)"
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("a", "V", Range::Positive)]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.outputs()
    }

    fn starts(&self, setting: &Setting, place: &Place) -> Vec<Vec<f64>> {
        let Place::Output(o) = *place else { return Vec::new() };
        [0.98, 0.85, 0.6].map(|share| vec![share * setting.y_max[o]]).to_vec()
    }

    fn free_shape(&self) -> Option<&'static Flexible> {
        Some(&Flexible::Sensor)
    }

    fn act(&self, _setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let Place::Output(o) = *place else { return Vec::new() };
        vec![Action::Sensor(Box::new(Clip { o, a: parameters[0] }))]
    }
}

struct Clip {
    o: usize,
    a: f64,
}

impl Sensor for Clip {
    fn apply(&self, y: &mut [Vec<f64>], _t0: f64, _rate: f64) {
        for y in &mut y[self.o] {
            *y = y.clamp(-self.a, self.a);
        }
    }
}
