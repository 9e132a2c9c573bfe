use super::{Action, Effect, Observation, Parameter, Place, Range, Setting, Side};

/// A random force in a frequency band. Its location is where the noise model finds the force.
pub struct ColouredDisturbance;

impl Effect for ColouredDisturbance {
    fn name(&self) -> &'static str {
        "coloured-disturbance"
    }

    fn side(&self) -> Side {
        Side::Disturbance
    }

    fn equation(&self) -> &'static str {
        "force at a port: band-pass noise of standard deviation a round f"
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("a", "force", Range::Positive), Parameter::new("f", "Hz", Range::Positive)]
    }

    fn places(&self, _setting: &Setting) -> Vec<Place> {
        Vec::new()
    }

    fn starts(&self, _setting: &Setting, _place: &Place) -> Vec<Vec<f64>> {
        Vec::new()
    }

    fn observed_in(&self) -> Observation {
        Observation::Band
    }

    fn act(&self, _setting: &Setting, _place: &Place, _parameters: &[f64]) -> Vec<Action> {
        vec![Action::Noise]
    }
}
