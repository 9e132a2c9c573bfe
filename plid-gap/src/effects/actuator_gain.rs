use super::{Action, Change, Effect, Parameter, Place, Range, Setting, Side, mix};

/// An actuator that is stronger or weaker than in the simulation.
pub struct ActuatorGain;

impl Effect for ActuatorGain {
    fn name(&self) -> &'static str {
        "actuator-gain"
    }

    fn side(&self) -> Side {
        Side::Actuator
    }

    fn equation(&self) -> &'static str {
        "u' = g u"
    }

    fn is_linear(&self) -> bool {
        true
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("g", "1", Range::Signed)]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.inputs()
    }

    fn starts(&self, _setting: &Setting, _place: &Place) -> Vec<Vec<f64>> {
        vec![vec![1.05]]
    }

    fn amplitude(&self) -> Option<(usize, f64)> {
        Some((0, 1.0))
    }

    fn change(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Option<Change> {
        let Place::Input(i) = *place else { return None };
        Change::of(format!("factor of input {}", setting.names.inputs[i]), 1.0, parameters[0])
    }

    fn is_number(&self) -> bool {
        true
    }

    fn acts_in_loop(&self) -> bool {
        true
    }

    fn act(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let Place::Input(i) = *place else { return Vec::new() };
        mix::commands(setting, [i, i], parameters[0] - 1.0)
    }
}
