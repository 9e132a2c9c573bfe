use super::setting::FARTHEST;
use super::{Action, Change, Effect, Parameter, Place, Range, Setting, Side};
use crate::plant::plain_hz;

/// A mode whose frequency differs from that of the simulation.
pub struct ModalFrequency;

impl Effect for ModalFrequency {
    fn name(&self) -> &'static str {
        "modal-frequency"
    }

    fn side(&self) -> Side {
        Side::Structure
    }

    fn equation(&self) -> &'static str {
        "w_m -> w_m (1 + delta)"
    }

    fn is_linear(&self) -> bool {
        true
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("delta", "1", Range::Signed)]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.modes()
    }

    /// Returns small changes, and changes to the frequencies of missing modes, because a mode that has moved far
    /// looks like a missing mode at its new frequency.
    fn starts(&self, setting: &Setting, place: &Place) -> Vec<Vec<f64>> {
        let mut starts = vec![0.004, -0.004, 0.012, -0.012, 0.03, -0.03];
        if let Place::Mode(k) = *place {
            let gone = setting.missing.iter().map(|mode| mode.hz / setting.plant.modes[k].hz() - 1.0);
            starts.extend(gone.filter(|delta| delta.abs() < FARTHEST));
        }
        starts.into_iter().map(|delta| vec![delta]).collect()
    }

    fn is_in_refit(&self) -> bool {
        true
    }

    fn change(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Option<Change> {
        let Place::Mode(k) = *place else { return None };
        let hz = setting.plant.modes[k].hz();
        let number = format!("frequency of the mode at {} Hz", plain_hz(hz));
        Some(Change { number, from: hz, to: hz * (1.0 + parameters[0]), unit: "Hz".into() })
    }

    fn act(&self, _setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let Place::Mode(k) = *place else { return Vec::new() };
        let factor = 1.0 + parameters[0];
        vec![Action::Plant(Box::new(move |plant| plant.move_pole(k, plant.modes[k].pole * factor)))]
    }
}
