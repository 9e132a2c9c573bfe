//! Gains and cross-talk: a share of one channel is added to another one, or to itself.

use super::{Action, Command, Drive, Memory, Sampling, Sensor, Setting};

/// A channel of which a share is added to another one, x'_to = x_to + share x_from.
struct Mix {
    from: usize,
    to: usize,
    share: f64,
}

/// Returns the action of a share of one command in another.
pub(super) fn commands(setting: &Setting, [from, to]: [usize; 2], share: f64) -> Vec<Action> {
    if setting.plant.controller.is_some() {
        // What the controller adds to the command is mixed as well.
        return vec![Action::Plant(Box::new(move |plant| plant.mix_inputs(from, to, share)))];
    }
    vec![Action::Command(Box::new(Mix { from, to, share }))]
}

/// Returns the action of a share of one output in another.
pub(super) fn outputs(setting: &Setting, [from, to]: [usize; 2], share: f64) -> Vec<Action> {
    if setting.plant.controller.is_some() {
        // The controller reads the mixed outputs.
        return vec![Action::Plant(Box::new(move |plant| plant.mix_outputs(from, to, share)))];
    }
    vec![Action::Sensor(Box::new(Mix { from, to, share }))]
}

impl Mix {
    fn apply(&self, channels: &mut [Vec<f64>]) {
        if self.from == self.to {
            for x in &mut channels[self.to] {
                *x *= 1.0 + self.share;
            }
            return;
        }
        let from = channels[self.from].clone();
        for (x, from) in channels[self.to].iter_mut().zip(from) {
            *x += self.share * from;
        }
    }
}

impl Command for Mix {
    fn apply(&self, drive: &mut Drive, _memory: &mut Memory) {
        self.apply(&mut drive.u);
    }
}

impl Sensor for Mix {
    fn apply(&self, y: &mut [Vec<f64>], _sampling: Sampling, _memory: &mut Memory) {
        self.apply(y);
    }
}
