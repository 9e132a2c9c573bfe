use super::{Action, Effect, Observation, Parameter, Place, Range, Setting, Side};

/// A sensor that is noisier than declared.
pub struct SensorNoise;

impl Effect for SensorNoise {
    fn name(&self) -> &'static str {
        "sensor-noise"
    }

    fn side(&self) -> Side {
        Side::Sensor
    }

    fn equation(&self) -> &'static str {
        "y' = y + white Gaussian noise on top of the declared"
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("std", "V", Range::Positive)]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.outputs()
    }

    fn starts(&self, _setting: &Setting, _place: &Place) -> Vec<Vec<f64>> {
        Vec::new()
    }

    fn observed_in(&self) -> Observation {
        Observation::SensorNoise
    }

    fn act(&self, _setting: &Setting, _place: &Place, _parameters: &[f64]) -> Vec<Action> {
        vec![Action::Noise]
    }
}
