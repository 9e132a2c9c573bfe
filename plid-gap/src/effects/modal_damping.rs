use super::{Action, Change, Effect, Parameter, Place, Range, Setting, Side};
use crate::plant::plain_hz;
use plid_fourier::C;

/// A mode whose damping ratio differs from that of the simulation.
pub struct ModalDamping;

impl Effect for ModalDamping {
    fn name(&self) -> &'static str {
        "modal-damping"
    }

    fn side(&self) -> Side {
        Side::Structure
    }

    fn equation(&self) -> &'static str {
        "zeta_m -> rho zeta_m"
    }

    fn is_linear(&self) -> bool {
        true
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("rho", "1", Range::Positive)]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.modes()
    }

    fn starts(&self, _setting: &Setting, _place: &Place) -> Vec<Vec<f64>> {
        [0.4, 0.7, 1.4, 2.5].map(|rho| vec![rho]).to_vec()
    }

    fn is_in_refit(&self) -> bool {
        true
    }

    fn change(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Option<Change> {
        let Place::Mode(k) = *place else { return None };
        let mode = &setting.plant.modes[k];
        let number = format!("damping ratio of the mode at {} Hz", plain_hz(mode.hz()));
        Change::of(number, mode.damping(), mode.damping() * parameters[0])
    }

    fn act(&self, _setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let Place::Mode(k) = *place else { return Vec::new() };
        let rho = parameters[0];
        vec![Action::Plant(Box::new(move |plant| {
            let (w, zeta) = (plant.modes[k].pole.norm(), (plant.modes[k].damping() * rho).min(0.99));
            plant.move_pole(k, C::new(-zeta * w, w * (1.0 - zeta * zeta).sqrt()));
        }))]
    }
}
