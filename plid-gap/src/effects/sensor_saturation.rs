use super::clip::{MOST_ROUND, clip};
use super::{Action, Effect, Flexible, Memory, Parameter, Place, Range, Sampling, Sensor, Setting, Side};

/// A sensor or an amplifier that clips.
///
/// With a second parameter, the corner of the limit is round.
pub struct SensorSaturation;

/// Roundness from which fits of a round limit start, near that of a hyperbolic tangent.
const ROUND: f64 = 0.4;

impl Effect for SensorSaturation {
    fn name(&self) -> &'static str {
        "sensor-saturation"
    }

    fn side(&self) -> Side {
        Side::Sensor
    }

    fn equation(&self) -> &'static str {
        "y' = min(max(y, -a), a); with r: y' = y / (1 + abs(y/a)^(1/abs(r)))^abs(r)"
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("a", "V", Range::Positive), Parameter::new("r", "1", Range::Signed).or_left_out()]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.outputs()
    }

    fn starts(&self, setting: &Setting, place: &Place) -> Vec<Vec<f64>> {
        let Place::Output(o) = *place else { return Vec::new() };
        let sharp = [0.98, 0.85, 0.6].map(|share| vec![share * setting.y_max[o]]);
        let round = [1.2, 2.5].map(|share| vec![share * setting.y_max[o], ROUND]);
        sharp.into_iter().chain(round).collect()
    }

    fn sound(&self, _setting: &Setting, _place: &Place, parameters: &[f64]) -> bool {
        parameters.get(1).is_none_or(|round| round.abs() <= MOST_ROUND)
    }

    fn free_shape(&self) -> Option<&'static Flexible> {
        Some(&Flexible::Sensor)
    }

    fn act(&self, _setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let Place::Output(o) = *place else { return Vec::new() };
        vec![Action::Sensor(Box::new(Clip { o, a: parameters[0], round: parameters.get(1).copied().unwrap_or(0.0) }))]
    }
}

struct Clip {
    o: usize,
    a: f64,
    round: f64,
}

impl Sensor for Clip {
    fn apply(&self, y: &mut [Vec<f64>], _sampling: Sampling, _memory: &mut Memory) {
        for y in &mut y[self.o] {
            *y = clip(*y, self.a, self.round);
        }
    }
}
