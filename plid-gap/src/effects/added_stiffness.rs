use std::f64::consts::TAU;

use crate::case::Limits;

use super::{Action, Change, Effect, Load, Parameter, Place, Range, Setting, Side};

/// A linear spring that the simulation lacks, or by which its stiffness is too large.
pub struct AddedStiffness;

impl Effect for AddedStiffness {
    fn name(&self) -> &'static str {
        "added-stiffness"
    }

    fn side(&self) -> Side {
        Side::Structure
    }

    fn equation(&self) -> &'static str {
        "f = -k d"
    }

    fn is_linear(&self) -> bool {
        true
    }

    fn is_number(&self) -> bool {
        true
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("k", "force/displacement", Range::Signed)]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.loads().into_iter().filter(|place| setting.sees_displacement(place)).collect()
    }

    fn starts(&self, setting: &Setting, place: &Place) -> Vec<Vec<f64>> {
        let port = setting.port(place);
        let other = setting.force[port] / setting.d_rms[port];
        let mut starts = setting.load_starts(setting.stiffness[port], other, Some(|factor| factor * factor - 1.0));
        // A spring at an unrestrained body causes a resonance, at whose frequency the residual has a peak.
        let mobility = setting.plant.mobility(port);
        if setting.stiffness[port] <= 0.0 && mobility > 0.0 {
            starts.extend(setting.missing.iter().map(|mode| vec![(TAU * mode.hz).powi(2) / mobility]));
        }
        starts
    }

    fn change(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Option<Change> {
        let stiffness = setting.plant.stiffness(&setting.plant.ports[setting.port(place)]);
        let number = format!("static stiffness at {}", place.location(&setting.names));
        Some(Change { number, from: stiffness, to: stiffness + parameters[0], unit: "force/displacement".into() })
    }

    fn own_std(&self, limits: &Limits) -> f64 {
        // A frequency is proportional to the root of the stiffness, so its relative error counts twice.
        limits.frequency
    }

    fn act(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        vec![Action::Load(setting.port(place), Load { stiffness: parameters[0], ..Load::default() })]
    }
}
