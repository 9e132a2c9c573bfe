use super::{Action, Effect, Observation, Parameter, Place, Range, Setting, Side};

/// A channel that sometimes repeats its last good value.
pub struct SensorDropout;

impl Effect for SensorDropout {
    fn name(&self) -> &'static str {
        "sensor-dropout"
    }

    fn side(&self) -> Side {
        Side::Sensor
    }

    fn equation(&self) -> &'static str {
        "at random instants the last good value repeats for a few samples"
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("rate", "1/sample", Range::Positive)]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.outputs()
    }

    fn starts(&self, _setting: &Setting, _place: &Place) -> Vec<Vec<f64>> {
        Vec::new()
    }

    fn observed_in(&self) -> Observation {
        Observation::Dropouts
    }

    fn act(&self, _setting: &Setting, _place: &Place, _parameters: &[f64]) -> Vec<Action> {
        vec![Action::Noise]
    }
}
