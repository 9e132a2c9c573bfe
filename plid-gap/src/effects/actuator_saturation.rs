use super::{Action, Command, Drive, Effect, Flexible, Parameter, Place, Range, Setting, Side};

/// An amplifier or actuator that gives less at large commands.
pub struct ActuatorSaturation;

impl Effect for ActuatorSaturation {
    fn name(&self) -> &'static str {
        "actuator-saturation"
    }

    fn side(&self) -> Side {
        Side::Actuator
    }

    fn equation(&self) -> &'static str {
        "u' = a tanh(u/a)"
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("a", "V", Range::Positive)]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.inputs()
    }

    fn starts(&self, setting: &Setting, place: &Place) -> Vec<Vec<f64>> {
        let Place::Input(i) = *place else { return Vec::new() };
        [1.2, 2.5, 5.0].map(|share| vec![share * setting.u_rms[i]]).to_vec()
    }

    fn free_shape(&self) -> Option<&'static Flexible> {
        Some(&Flexible::Command)
    }

    fn act(&self, _setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let Place::Input(i) = *place else { return Vec::new() };
        vec![Action::Command(Box::new(Saturation { i, a: parameters[0] }))]
    }
}

struct Saturation {
    i: usize,
    a: f64,
}

impl Command for Saturation {
    fn apply(&self, drive: &mut Drive) {
        for u in &mut drive.u[self.i] {
            *u = self.a * (*u / self.a).tanh();
        }
    }
}
