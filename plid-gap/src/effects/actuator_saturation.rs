use super::clip::{MOST_ROUND, clip};
use super::tanh::tanh;
use super::{Action, Command, Drive, Effect, Flexible, Memory, Parameter, Place, Range, Setting, Side};

/// An amplifier or actuator whose gain falls at large commands.
///
/// The optional second parameter r sets the roundness of the corner of the limit. With r = 0, the corner is sharp.
pub struct ActuatorSaturation;

/// Roundness from which fits of a sharp limit start.
const NEARLY_SHARP: f64 = 0.1;

impl Effect for ActuatorSaturation {
    fn name(&self) -> &'static str {
        "actuator-saturation"
    }

    fn side(&self) -> Side {
        Side::Actuator
    }

    fn equation(&self) -> &'static str {
        "u' = a tanh(u/a); with r: u' = u / (1 + abs(u/a)^(1/abs(r)))^abs(r), a sharp limit for r = 0"
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("a", "V", Range::Positive), Parameter::new("r", "1", Range::Signed).or_left_out()]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.inputs()
    }

    fn starts(&self, setting: &Setting, place: &Place) -> Vec<Vec<f64>> {
        let Place::Input(i) = *place else { return Vec::new() };
        let plain = [1.2, 2.5, 5.0].map(|share| vec![share * setting.u_rms[i]]);
        let sharp = [0.7, 1.3, 2.2].map(|share| vec![share * setting.u_rms[i], NEARLY_SHARP]);
        plain.into_iter().chain(sharp).collect()
    }

    fn sound(&self, _setting: &Setting, _place: &Place, parameters: &[f64]) -> bool {
        parameters.get(1).is_none_or(|round| round.abs() <= MOST_ROUND)
    }

    fn free_shape(&self) -> Option<&'static Flexible> {
        Some(&Flexible::Command)
    }

    fn act(&self, _setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let Place::Input(i) = *place else { return Vec::new() };
        vec![Action::Command(Box::new(Saturation { i, a: parameters[0], round: parameters.get(1).copied() }))]
    }
}

struct Saturation {
    i: usize,
    a: f64,
    round: Option<f64>,
}

impl Command for Saturation {
    fn apply(&self, drive: &mut Drive, _memory: &mut Memory) {
        for u in &mut drive.u[self.i] {
            *u = self.round.map_or_else(|| self.a * tanh(*u / self.a), |round| clip(*u, self.a, round));
        }
    }
}
