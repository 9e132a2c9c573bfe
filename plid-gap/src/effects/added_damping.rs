use crate::case::Limits;

use super::{Action, Change, Effect, Load, Parameter, Place, Range, Setting, Side};

/// Viscous damping that the simulation lacks, such as that of a bearing, or of which it has too much.
pub struct AddedDamping;

impl Effect for AddedDamping {
    fn name(&self) -> &'static str {
        "added-damping"
    }

    fn side(&self) -> Side {
        Side::Structure
    }

    fn equation(&self) -> &'static str {
        "f = -c v"
    }

    fn is_linear(&self) -> bool {
        true
    }

    fn is_number(&self) -> bool {
        true
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("c", "force/velocity", Range::Signed)]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.loads()
    }

    fn starts(&self, setting: &Setting, place: &Place) -> Vec<Vec<f64>> {
        let port = setting.port(place);
        setting.load_starts(setting.plant.damper(port), setting.force[port] / setting.v_rms[port], None)
    }

    fn change(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Option<Change> {
        let damper = setting.plant.damper(setting.port(place));
        let number = format!("viscous damping at {}", place.location(&setting.names));
        Some(Change { number, from: damper, to: damper + parameters[0], unit: "force/velocity".into() })
    }

    fn own_std(&self, limits: &Limits) -> f64 {
        limits.damping / 2.0
    }

    fn act(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        vec![Action::Load(setting.port(place), Load { damping: parameters[0], ..Load::default() })]
    }
}
