use super::{Action, Change, Effect, Parameter, Place, Range, Setting, Side, mix};

/// A sensor with a calibration error.
pub struct SensorGain;

impl Effect for SensorGain {
    fn name(&self) -> &'static str {
        "sensor-gain"
    }

    fn side(&self) -> Side {
        Side::Sensor
    }

    fn equation(&self) -> &'static str {
        "y' = g y"
    }

    fn is_linear(&self) -> bool {
        true
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("g", "1", Range::Signed)]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.outputs()
    }

    fn starts(&self, _setting: &Setting, _place: &Place) -> Vec<Vec<f64>> {
        vec![vec![1.05]]
    }

    fn amplitude(&self) -> Option<(usize, f64)> {
        Some((0, 1.0))
    }

    fn change(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Option<Change> {
        let Place::Output(o) = *place else { return None };
        Change::of(format!("factor of output {}", setting.names.outputs[o]), 1.0, parameters[0])
    }

    fn is_number(&self) -> bool {
        true
    }

    fn acts_in_loop(&self) -> bool {
        true
    }

    fn act(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let Place::Output(o) = *place else { return Vec::new() };
        mix::outputs(setting, [o, o], parameters[0] - 1.0)
    }
}
