use super::taps::Taps;
use super::{Action, Command, Drive, Effect, Flexible, Memory, Parameter, Place, Range, Setting, Side};

/// A delay of the command, at one input or at all inputs.
pub struct ActuatorDelay;

impl Effect for ActuatorDelay {
    fn name(&self) -> &'static str {
        "actuator-delay"
    }

    fn side(&self) -> Side {
        Side::Actuator
    }

    fn family(&self) -> Option<&'static str> {
        Some("a delayed command")
    }

    fn equation(&self) -> &'static str {
        "u'(t) = u(t - tau)"
    }

    fn is_linear(&self) -> bool {
        true
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("tau", "samples", Range::Positive)]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.inputs().into_iter().chain((setting.plant.m > 1).then_some(Place::AllInputs)).collect()
    }

    fn starts(&self, _setting: &Setting, _place: &Place) -> Vec<Vec<f64>> {
        [0.1, 0.5, 1.5, 4.0, 10.0].map(|samples| vec![samples]).to_vec()
    }

    fn free_shape(&self) -> Option<&'static Flexible> {
        Some(&Flexible::Path)
    }

    fn act(&self, _setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        vec![Action::Command(Box::new(Delay { place: place.clone(), tau: parameters[0] }))]
    }
}

/// Number of parts of a sample.
const PARTS: usize = 4;

struct Delay {
    place: Place,
    tau: f64,
}

impl Command for Delay {
    fn apply(&self, drive: &mut Drive, memory: &mut Memory) {
        drive.refine(PARTS);
        let delay = Taps::of_command(self.tau * drive.parts as f64);
        for (i, channel) in drive.u.iter_mut().enumerate() {
            if self.place == Place::AllInputs || self.place == Place::Input(i) {
                delay.apply((i, channel), 0.0, memory);
            }
        }
    }
}
