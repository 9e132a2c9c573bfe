use super::{Action, Change, Effect, Parameter, Place, Range, Setting, Side, mix};

/// A signal that also reaches another channel.
pub struct SensorCrosstalk;

impl Effect for SensorCrosstalk {
    fn name(&self) -> &'static str {
        "sensor-crosstalk"
    }

    fn side(&self) -> Side {
        Side::Sensor
    }

    fn equation(&self) -> &'static str {
        "y'_j = y_j + c y_i"
    }

    fn is_linear(&self) -> bool {
        true
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("c", "1", Range::Signed)]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        super::pairs(setting.plant.p, Place::OutputToOutput)
    }

    fn starts(&self, _setting: &Setting, _place: &Place) -> Vec<Vec<f64>> {
        vec![vec![0.03]]
    }

    fn amplitude(&self) -> Option<(usize, f64)> {
        Some((0, 0.0))
    }

    fn change(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Option<Change> {
        let Place::OutputToOutput(i, j) = *place else { return None };
        let names = &setting.names.outputs;
        Change::of(format!("share of {} in {}", names[i], names[j]), 0.0, parameters[0])
    }

    fn is_number(&self) -> bool {
        true
    }

    fn acts_in_loop(&self) -> bool {
        true
    }

    fn act(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let Place::OutputToOutput(i, j) = *place else { return Vec::new() };
        mix::outputs(setting, [i, j], parameters[0])
    }
}
