//! The effects between a controller and its plant, which act sample by sample: each command passes through them to the
//! plant, and each output to the controller.

use crate::effects::{Action, Command, Drive, Memory, Sampling, Sensor};

/// The effects on commands and measurements in one run, and what they remember.
pub struct Between<'a> {
    commands: Vec<(&'a dyn Command, Memory)>,
    sensors: Vec<(&'a dyn Sensor, Memory)>,
    /// The commands of one sample.
    drive: Drive,
    /// The outputs of one sample, as the controller reads them: p channels of one value.
    read: Vec<Vec<f64>>,
    at_rest: bool,
}

impl<'a> Between<'a> {
    /// Collects the effects of a run from time `t0` of a plant with `m` inputs and `p` outputs.
    pub fn new(actions: &'a [Action], [m, p]: [usize; 2], rate: f64, t0: f64, at_rest: bool) -> Self {
        let command = |action: &'a Action| match action {
            Action::Command(command) => Some((command.as_ref(), Memory::default())),
            _ => None,
        };
        let sensor = |action: &'a Action| match action {
            Action::Sensor(sensor) if sensor.reaches_controller() => Some((sensor.as_ref(), Memory::default())),
            _ => None,
        };
        Self {
            commands: actions.iter().filter_map(command).collect(),
            sensors: actions.iter().filter_map(sensor).collect(),
            drive: Drive::new(&vec![vec![0.0]; m], rate, t0),
            read: vec![vec![0.0]; p],
            at_rest,
        }
    }

    /// Returns the least number of parts of a sample for the commands.
    pub fn parts(&self) -> usize {
        let mut drive = self.drive.clone();
        self.commands.iter().for_each(|(command, _)| command.apply(&mut drive, &mut Memory::default()));
        drive.parts
    }

    /// Returns whether there are no effects.
    pub fn is_empty(&self) -> bool {
        self.commands.is_empty() && self.sensors.is_empty()
    }

    /// Passes the commands of the sample at a time in s to the plant. Returns m channels of `parts` values.
    pub fn command(&mut self, t: f64, parts: usize, u: impl Fn(usize) -> f64) -> &[Vec<f64>] {
        let Self { drive, commands, .. } = self;
        // Each effect divides a sample into as many parts as in open loop; forces may need more.
        (drive.parts, drive.t0) = (1, t);
        for (i, channel) in drive.u.iter_mut().enumerate() {
            channel.clear();
            channel.push(u(i));
        }
        commands.iter_mut().for_each(|(command, memory)| command.apply(drive, memory));
        drive.refine(parts);
        &drive.u
    }

    /// Passes the outputs of the sample at a time in s to the controller. Returns p channels of one value. The effects
    /// remember them only if they are the `last` ones of the sample.
    pub fn measure(&mut self, t: f64, y: impl Fn(usize) -> f64, last: bool) -> &[Vec<f64>] {
        let Self { sensors, read, .. } = self;
        let sampling = Sampling { t0: t, rate: self.drive.rate, at_rest: self.at_rest };
        read.iter_mut().enumerate().for_each(|(o, read)| read[0] = y(o));
        for (sensor, memory) in sensors {
            if last {
                sensor.apply(read, sampling, memory);
            } else {
                sensor.apply(read, sampling, &mut memory.clone());
            }
        }
        read
    }
}
