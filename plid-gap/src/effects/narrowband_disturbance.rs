use super::{Action, Effect, Parameter, Place, Range, Setting, Side};
use std::f64::consts::{PI, TAU};

/// A machine that shakes the structure at one frequency.
pub struct NarrowbandDisturbance;

impl Effect for NarrowbandDisturbance {
    fn name(&self) -> &'static str {
        "narrowband-disturbance"
    }

    fn side(&self) -> Side {
        Side::Disturbance
    }

    fn equation(&self) -> &'static str {
        "force a sin(2 pi f t + phi) at a port"
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![
            Parameter::new("a", "force", Range::Signed),
            Parameter::new("f", "Hz", Range::Hz),
            Parameter::new("phi", "rad", Range::Angle),
        ]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        let stands = |k: &usize| setting.plant.ports[*k].moved_by().is_none();
        let ports = (0..setting.plant.ports.len()).filter(|&k| !setting.is_on_a_mode(k)).filter(stands);
        ports.flat_map(|port| setting.tones.iter().map(move |tone| Place::Frequency(tone.hz, port))).collect()
    }

    fn starts(&self, setting: &Setting, place: &Place) -> Vec<Vec<f64>> {
        let Place::Frequency(hz, port) = *place else { return Vec::new() };
        let a = 0.05 * setting.force[port];
        [0.0, 0.5].map(|turns| vec![a, hz, turns * PI]).to_vec()
    }

    fn amplitude(&self) -> Option<(usize, f64)> {
        Some((0, 0.0))
    }

    fn phase(&self) -> Option<usize> {
        Some(2)
    }

    fn act(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let (a, f, phi) = (parameters[0], parameters[1], parameters[2]);
        vec![Action::Disturbance(setting.port(place), Box::new(move |t| a * (TAU * f * t + phi).sin()))]
    }
}
