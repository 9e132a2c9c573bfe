use super::{Action, Command, Drive, Effect, Parameter, Place, Range, Setting, Side};

/// A command that arrives late, at one input or at all.
pub struct ActuatorDelay;

impl Effect for ActuatorDelay {
    fn name(&self) -> &'static str {
        "actuator-delay"
    }

    fn side(&self) -> Side {
        Side::Actuator
    }

    fn equation(&self) -> &'static str {
        "u'(t) = u(t - tau)"
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("tau", "samples", Range::Positive)]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.inputs().into_iter().chain((setting.plant.m > 1).then_some(Place::AllInputs)).collect()
    }

    fn starts(&self, _setting: &Setting, _place: &Place) -> Vec<Vec<f64>> {
        vec![vec![0.1], vec![0.5], vec![1.5]]
    }

    fn act(&self, _setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        vec![Action::Command(Box::new(Delay { place: place.clone(), tau: parameters[0] }))]
    }
}

/// Parts of a sample. A step inside one is a parabola's weights on the steps at the three next edges, so that its mean, its delay and
/// the delay's square are right; with two edges alone a delay of a tenth of a sample was 6 % wrong.
const PARTS: usize = 4;

struct Delay {
    place: Place,
    tau: f64,
}

impl Command for Delay {
    fn apply(&self, drive: &mut Drive) {
        drive.refine(PARTS);
        let parts = self.tau * drive.parts as f64;
        let (whole, share) = (parts.floor() as usize, parts.fract());
        for (i, channel) in drive.u.iter_mut().enumerate() {
            if self.place != Place::AllInputs && self.place != Place::Input(i) {
                continue;
            }
            let at = |k: usize, back: usize| if k >= back { channel[k - back] } else { 0.0 };
            let weights = [(1.0 - share) * (2.0 - share) / 2.0, share * (2.0 - share), -share * (1.0 - share) / 2.0];
            *channel = (0..channel.len()).map(|k| (0..3).map(|j| weights[j] * at(k, whole + j)).sum()).collect();
        }
    }
}
