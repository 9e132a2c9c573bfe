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

    /// Rejects a pole that no record can show as a resonance, because such a pole is not a mode. Outside the band that
    /// counts, nothing shows it.
    fn sound(&self, setting: &Setting, _place: &Place, parameters: &[f64]) -> bool {
        let (hz, zeta) = (parameters[0], parameters[1]);
        hz < 0.5 * setting.plant.rate && hz * setting.duration_s > 1.0 && zeta < 1.0 && setting.counts(hz)
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::{Known, prepare};
    use crate::testing;

    /// A mode at 186 Hz is missing. It is offered and accepted as a mode only if it lies within the band that counts.
    #[test]
    fn a_missing_mode_lies_in_the_band() {
        let sim = testing::truss_with(1, |_, shapes, _| shapes.row_mut(2).fill(0.0));
        let case = testing::case(&sim, &testing::truss(1));
        for (band_hz, offered) in [(None, true), (Some([100.0, 250.0]), true), (Some([20.0, 160.0]), false)] {
            let known = Known { band_hz, ..Known::default() };
            let setting = prepare(case.model.as_ref().unwrap(), &case.records, &known).unwrap().problem.setting;
            let places = MissingMode.places(&setting);
            let is_near = |place: &Place| matches!(place, Place::MissingMode(hz) if (hz / 186.0 - 1.0).abs() < 0.02);
            assert_eq!(places.iter().any(is_near), offered, "{band_hz:?}: {places:?}");
            let sound = |hz: f64, zeta: f64| {
                let parameters = [vec![hz, zeta], vec![1.0; 4]].concat();
                MissingMode.sound(&setting, &Place::MissingMode(hz), &parameters)
            };
            assert_eq!(sound(186.0, 0.01), offered, "{band_hz:?}");
            assert!(sound(150.0, 0.01) && !sound(150.0, 1.0), "{band_hz:?}");
        }
    }
}
