use crate::case::Limits;

use super::{Action, Change, Effect, Load, Parameter, Place, Range, Setting, Side};

/// A mass that the simulation lacks, such as a payload, or by which its inertia is too large.
pub struct AddedMass;

impl Effect for AddedMass {
    fn name(&self) -> &'static str {
        "added-mass"
    }

    fn side(&self) -> Side {
        Side::Structure
    }

    fn equation(&self) -> &'static str {
        "f = -m dv/dt"
    }

    fn is_linear(&self) -> bool {
        true
    }

    fn is_number(&self) -> bool {
        true
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("m", "force/acceleration", Range::Signed)]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.inertias()
    }

    fn starts(&self, setting: &Setting, place: &Place) -> Vec<Vec<f64>> {
        let inertia = setting.plant.mobility(setting.port(place)).recip();
        setting.load_starts(inertia, 1.0, Some(|factor| factor.powi(-2) - 1.0))
    }

    fn sound(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> bool {
        // Enough of the inertia at the port must remain.
        1.0 + parameters[0] * setting.plant.mobility(setting.port(place)) > Load::LEAST_INERTIA
    }

    fn change(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Option<Change> {
        let inertia = setting.plant.mobility(setting.port(place)).recip();
        let number = format!("inertia at {}", place.location(&setting.names));
        Some(Change { number, from: inertia, to: inertia + parameters[0], unit: "force/acceleration".into() })
    }

    fn own_std(&self, limits: &Limits) -> f64 {
        // A frequency is proportional to one over the root of the inertia, so its relative error counts twice.
        limits.frequency
    }

    fn act(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        vec![Action::Load(setting.port(place), Load { mass: parameters[0], ..Load::default() })]
    }
}
