use super::{Action, Change, Effect, Parameter, Place, Range, Setting, Side, mix};

/// A command that also reaches another actuator.
pub struct ActuatorCrosstalk;

impl Effect for ActuatorCrosstalk {
    fn name(&self) -> &'static str {
        "actuator-crosstalk"
    }

    fn side(&self) -> Side {
        Side::Actuator
    }

    fn equation(&self) -> &'static str {
        "u'_j = u_j + c u_i"
    }

    fn is_linear(&self) -> bool {
        true
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("c", "1", Range::Signed)]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        super::pairs(setting.plant.m, Place::InputToInput)
    }

    fn starts(&self, _setting: &Setting, _place: &Place) -> Vec<Vec<f64>> {
        vec![vec![0.05]]
    }

    fn amplitude(&self) -> Option<(usize, f64)> {
        Some((0, 0.0))
    }

    fn change(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Option<Change> {
        let Place::InputToInput(i, j) = *place else { return None };
        let names = &setting.names.inputs;
        Change::of(format!("share of {} in {}", names[i], names[j]), 0.0, parameters[0])
    }

    fn is_number(&self) -> bool {
        true
    }

    fn acts_in_loop(&self) -> bool {
        true
    }

    fn act(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let Place::InputToInput(i, j) = *place else { return Vec::new() };
        mix::commands(setting, [i, j], parameters[0])
    }
}
