use std::f64::consts::TAU;

use super::{Action, Effect, Parameter, Place, Range, Setting, Side};
use crate::plant::Plant;
use plid_fourier::C;

/// A mode that the simulation lacks: q" + 2 zeta w q' + w^2 q = b.a. Each output measures the same derivative of c q
/// as it does of the other modes.
///
/// The forces on the mode pass the actuators, and its motion passes the filters, as far as the simulation contains
/// these.
pub struct MissingMode;

impl Effect for MissingMode {
    fn name(&self) -> &'static str {
        "missing-mode"
    }

    fn side(&self) -> Side {
        Side::Structure
    }

    fn equation(&self) -> &'static str {
        "one mode more: q\" + 2 zeta w q' + w^2 q = b.a, outputs sense c q, c q' or c q\", w = 2 pi f, norm(c) = 1"
    }

    fn is_linear(&self) -> bool {
        true
    }

    fn parameters(&self, setting: &Setting) -> Vec<Parameter> {
        let names = &setting.names;
        let head = [Parameter::new("f", "Hz", Range::Positive), Parameter::new("zeta", "1", Range::Positive)];
        let b = names.inputs.iter().map(|name| Parameter::new(format!("b_{name}"), "V/V", Range::Signed));
        let c = names.outputs.iter().map(|name| Parameter::new(format!("c_{name}"), "1", Range::Direction));
        head.into_iter().chain(b).chain(c).collect()
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.missing.iter().map(|mode| Place::MissingMode(mode.hz)).collect()
    }

    fn starts(&self, setting: &Setting, place: &Place) -> Vec<Vec<f64>> {
        let at = |hz: f64| *place == Place::MissingMode(hz);
        let start = |mode: &super::MissingModeStart| {
            [mode.hz, mode.damping].iter().chain(&mode.b).chain(&mode.c).copied().collect()
        };
        setting.missing.iter().filter(|mode| at(mode.hz)).map(start).collect()
    }

    /// Rejects a pole that no record can show as a resonance, because such a pole is not a mode.
    fn sound(&self, setting: &Setting, _place: &Place, parameters: &[f64]) -> bool {
        let (hz, zeta) = (parameters[0], parameters[1]);
        hz < 0.5 * setting.plant.rate && hz * setting.duration_s > 1.0 && zeta < 1.0
    }

    fn fitted_place(&self, _place: &Place, parameters: &[f64]) -> Place {
        Place::MissingMode(parameters[0])
    }

    fn adds_mode(&self) -> bool {
        true
    }

    fn act(&self, _setting: &Setting, _place: &Place, parameters: &[f64]) -> Vec<Action> {
        let parameters = parameters.to_vec();
        vec![Action::Plant(Box::new(move |plant| add(plant, &parameters)))]
    }
}

/// Appends the mode. `c` is normalised, so that `b` alone contains the scale.
fn add(plant: &mut Plant, parameters: &[f64]) {
    let (m, p) = (plant.m, plant.p);
    let (w, zeta) = (TAU * parameters[0], parameters[1].min(0.99));
    let c = &parameters[2 + m..2 + m + p];
    let size = (c.iter().map(|c| c * c).sum::<f64>()).sqrt().max(f64::MIN_POSITIVE);
    let c: Vec<f64> = c.iter().map(|c| c / size).collect();
    plant.add_mode(C::new(-zeta * w, w * (1.0 - zeta * zeta).sqrt()), &parameters[2..2 + m], &c);
}
