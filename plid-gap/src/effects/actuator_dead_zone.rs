use super::{Action, Command, Drive, Effect, Flexible, Memory, Parameter, Place, Range, Setting, Side};

/// An actuator that does not respond to small commands.
pub struct ActuatorDeadZone;

impl Effect for ActuatorDeadZone {
    fn name(&self) -> &'static str {
        "actuator-dead-zone"
    }

    fn side(&self) -> Side {
        Side::Actuator
    }

    fn equation(&self) -> &'static str {
        "u' = sign(u) max(abs(u) - delta, 0)"
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("delta", "V", Range::Positive)]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.inputs()
    }

    fn starts(&self, setting: &Setting, place: &Place) -> Vec<Vec<f64>> {
        let Place::Input(i) = *place else { return Vec::new() };
        [0.05, 0.15, 0.5].map(|share| vec![share * setting.u_rms[i]]).to_vec()
    }

    fn free_shape(&self) -> Option<&'static Flexible> {
        Some(&Flexible::Command)
    }

    fn act(&self, _setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let Place::Input(i) = *place else { return Vec::new() };
        vec![Action::Command(Box::new(DeadZone { i, delta: parameters[0] }))]
    }
}

struct DeadZone {
    i: usize,
    delta: f64,
}

impl Command for DeadZone {
    fn apply(&self, drive: &mut Drive, _memory: &mut Memory) {
        for u in &mut drive.u[self.i] {
            *u = u.signum() * (u.abs() - self.delta).max(0.0);
        }
    }
}
