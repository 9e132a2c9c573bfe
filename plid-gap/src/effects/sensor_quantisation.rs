use super::{Action, Effect, Memory, Observation, Parameter, Place, Range, Sampling, Sensor, Setting, Side};

/// A converter that is coarser than the others, found in the raw values. If it rounds, no free run changes. If it
/// truncates, it moves every value towards zero by half a step on average.
pub struct SensorQuantisation;

impl Effect for SensorQuantisation {
    fn name(&self) -> &'static str {
        "sensor-quantisation"
    }

    fn side(&self) -> Side {
        Side::Sensor
    }

    fn equation(&self) -> &'static str {
        "y' = q round(y/q) where cut = 0; where bits are cut off, cut = 0.5 and y' = q trunc(y/q), in the mean sgn(y) \
        max(|y| - cut q, 0)"
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("q", "V", Range::Positive), Parameter::new("cut", "steps", Range::Signed)]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.outputs()
    }

    fn starts(&self, _setting: &Setting, _place: &Place) -> Vec<Vec<f64>> {
        Vec::new()
    }

    fn observed_in(&self) -> Observation {
        Observation::Quantisation
    }

    fn act(&self, _setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let (&Place::Output(o), &[q, cut]) = (place, parameters) else { return vec![Action::Noise] };
        if cut > 0.0 { vec![Action::Sensor(Box::new(Cut { o, by: cut * q }))] } else { vec![Action::Noise] }
    }
}

struct Cut {
    o: usize,
    by: f64,
}

impl Sensor for Cut {
    fn apply(&self, y: &mut [Vec<f64>], _sampling: Sampling, _memory: &mut Memory) {
        for y in &mut y[self.o] {
            *y = (y.abs() - self.by).max(0.0).copysign(*y);
        }
    }

    /// The fits add what truncation takes to the records, so that a controller reads values without it.
    fn reaches_controller(&self) -> bool {
        false
    }
}
