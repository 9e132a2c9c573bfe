use super::{Action, Command, Drive, Effect, Flexible, Memory, Parameter, Place, Range, Setting, Side};

/// Value of alpha above which the effect has a caveat. At a reversal, the slope of u' is 1 - alpha times that of the
/// command. Among 29 hysteretic actuators in development, the largest alpha was 0.88, at a gap of 26 %. In eight cases
/// with actuators that stick at each reversal, the fitted alpha was 0.95 to 1.18.
const STANDS_STILL: f64 = 0.9;

/// A piezoelectric or magnetic actuator whose output depends on the history of the command.
pub struct ActuatorHysteresis;

impl Effect for ActuatorHysteresis {
    fn name(&self) -> &'static str {
        "actuator-hysteresis"
    }

    fn side(&self) -> Side {
        Side::Actuator
    }

    fn equation(&self) -> &'static str {
        "u' = u - z, dz = alpha du - (abs(du) z + du abs(z)) / (2 uy)"
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("alpha", "1", Range::Positive), Parameter::new("uy", "V", Range::Positive)]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.inputs()
    }

    fn starts(&self, setting: &Setting, place: &Place) -> Vec<Vec<f64>> {
        let Place::Input(i) = *place else { return Vec::new() };
        [0.3, 0.9, 2.5].map(|share| vec![0.02, share * setting.u_rms[i]]).to_vec()
    }

    fn amplitude(&self) -> Option<(usize, f64)> {
        Some((0, 0.0))
    }

    fn sound(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> bool {
        let Place::Input(i) = *place else { return false };
        // Above this range, the hysteresis never yields and is a gain; far below it, the hysteresis yields at once
        // and is a shift.
        (0.005..8.0).contains(&(parameters[1] / setting.u_rms[i]))
    }

    fn caveat(&self, parameters: &[f64]) -> Option<&'static str> {
        (parameters[0] > STANDS_STILL).then_some(
            "alpha is about one: the actuator stops at every reversal of the command, which material hysteresis hardly \
            ever causes",
        )
    }

    fn free_shape(&self) -> Option<&'static Flexible> {
        Some(&Flexible::Hysteresis)
    }

    fn act(&self, _setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let Place::Input(i) = *place else { return Vec::new() };
        vec![Action::Command(Box::new(Hysteresis { i, alpha: parameters[0], uy: parameters[1] }))]
    }
}

struct Hysteresis {
    i: usize,
    alpha: f64,
    uy: f64,
}

impl Command for Hysteresis {
    fn apply(&self, drive: &mut Drive, memory: &mut Memory) {
        let [z, before] = memory.values([0.0; 2]);
        for u in &mut drive.u[self.i] {
            *z = super::slip::advance(*z, *u - *before, self.alpha, self.uy);
            *before = *u;
            *u -= *z;
        }
    }
}
