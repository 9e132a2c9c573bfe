//! Runs of the engineer's own simulator with effects around it and at its ports.

use plid_simulator::{Calls, Checked, Description, Motion, SimulatorError};

use crate::case::record::{Channels, Record};
use crate::effects::{Action, Drive, Force, Setting};
use crate::fit::problem::Placed;
use crate::in_loop::coupling::{Coupling, Response};
use crate::plant::Load;

/// Number of runs that are remembered: those of the last explanations on a few records.
const REMEMBERED: usize = 256;

/// The simulator, with what is known of its ports and its latest runs.
pub(super) struct Runs<'s> {
    simulator: Checked<'s>,
    responses: Vec<Response>,
    remembered: Vec<Remembered>,
    rest: Option<Rest>,
}

/// A simulator that stays at rest without inputs: its outputs there (p).
struct Rest {
    outputs: Vec<f64>,
}

/// A run before the sensors.
struct Remembered {
    record: String,
    samples: usize,
    effects: Vec<Written>,
    y: Channels,
}

/// Name, location and parameters of an effect that reaches the simulator.
type Written = (String, String, Vec<f64>);

/// What acts at the simulator's ports in one run.
#[derive(Default)]
struct AtPorts<'a> {
    laws: Vec<(usize, &'a dyn Force)>,
    loads: Vec<(usize, Load)>,
    pushes: Vec<(usize, &'a (dyn Fn(f64) -> f64 + Send + Sync))>,
}

impl AtPorts<'_> {
    fn is_empty(&self) -> bool {
        self.laws.is_empty() && self.loads.is_empty() && self.pushes.is_empty()
    }
}

impl<'s> Runs<'s> {
    /// Of a simulator whose ports have these responses.
    pub fn new(simulator: Checked<'s>, responses: Vec<Response>) -> Self {
        Self { simulator, responses, remembered: Vec::new(), rest: None }
    }

    /// Learns from a run without effects whether the simulator stays at rest: no input moved, and no output did. Such
    /// a run need not be repeated with effects that do nothing at rest. `start` is the motion of the ports there.
    pub fn learn_rest(&mut self, record: &Record, y: &[Vec<f64>], start: &[Motion]) {
        let still = |y: &Vec<f64>| y.iter().all(|value| *value == y[0]);
        let moved = record.u.iter().flatten().any(|u| *u != 0.0);
        if !moved && record.samples() > 1 && y.iter().all(still) && start.iter().all(|at| *at == Motion::default()) {
            self.rest = Some(Rest { outputs: y.iter().map(|y| y[0]).collect() });
        }
    }

    /// Returns the outputs of a run in which nothing can move the simulator.
    fn resting(&self, drive: &Drive, values: &[f64], at: &AtPorts) -> Option<Channels> {
        let rest = self.rest.as_ref()?;
        let driven = drive.u.iter().flatten().any(|u| *u != 0.0);
        let acts =
            |(_, law): &(usize, &dyn Force)| law.force(0.0, 0.0, 0.0) != 0.0 || law.advance(0.0, 0.0, 0.0) != 0.0;
        if driven || !at.pushes.is_empty() || at.laws.iter().any(acts) || values != self.description().values() {
            return None;
        }
        let samples = drive.u.first().map_or(0, Vec::len) / drive.parts;
        Some(rest.outputs.iter().map(|y| vec![*y; samples]).collect())
    }

    /// Returns what the simulator has.
    pub fn description(&self) -> &Description {
        self.simulator.description()
    }

    /// Returns the calls so far.
    pub fn calls(&self) -> Calls {
        self.simulator.calls()
    }

    /// Returns the outputs (p channels) for the inputs of a record, with effects.
    ///
    /// # Errors
    /// [`SimulatorError`] if the simulator fails.
    pub fn simulate(
        &mut self,
        setting: &Setting,
        effects: &[Placed],
        record: &Record,
    ) -> Result<Channels, SimulatorError> {
        let acting: Vec<Vec<Action>> = effects.iter().map(|p| p.effect.act(setting, &p.place, &p.parameters)).collect();
        let inside: Vec<Written> = effects
            .iter()
            .zip(&acting)
            .filter(|(_, actions)| !actions.iter().all(|action| matches!(action, Action::Sensor(_))))
            .map(|(placed, _)| written(placed, setting))
            .collect();
        let actions: Vec<&Action> = acting.iter().flatten().collect();
        let same = |known: &Remembered| {
            known.record == record.name && known.samples == record.samples() && known.effects == inside
        };
        let mut y = match self.remembered.iter().find(|known| same(known)) {
            Some(known) => known.y.clone(),
            None => {
                let y = self.run(&actions, record, setting.plant.rate)?;
                if self.remembered.len() == REMEMBERED {
                    // The first runs are those without effects, which are asked for to the end.
                    self.remembered.remove(REMEMBERED / 2);
                }
                let (record, samples) = (record.name.clone(), record.samples());
                self.remembered.push(Remembered { record, samples, effects: inside, y: y.clone() });
                y
            }
        };
        for action in actions {
            if let Action::Sensor(sensor) = action {
                sensor.apply(&mut y, record.start_s, setting.plant.rate);
            }
        }
        Ok(y)
    }

    fn run(&mut self, actions: &[&Action], record: &Record, rate: f64) -> Result<Channels, SimulatorError> {
        let mut values = self.description().values();
        let mut drive = Drive::new(&record.u, rate, record.start_s);
        let mut at = AtPorts::default();
        for action in actions {
            match action {
                Action::Command(command) => command.apply(&mut drive),
                Action::Parameter(number, value) => values[*number] = *value,
                Action::Force(port, law) => at.laws.push((*port, law.as_ref())),
                Action::Load(port, load) => at.loads.push((*port, *load)),
                Action::Disturbance(port, of) => at.pushes.push((*port, of.as_ref())),
                Action::Sensor(_) | Action::Noise => {}
                Action::Plant(_) | Action::Stiffness(_) => unreachable!("such effects are not among the candidates"),
            }
        }
        if let Some(y) = self.resting(&drive, &values, &at) {
            return Ok(y);
        }
        let steps = self.description().steps_per_sample;
        if at.is_empty() && (drive.parts == 1 || steps < 2) {
            return self.simulator.run(&values, &regrouped(&drive, 1));
        }
        let u = regrouped(&drive, steps);
        self.stepped(&values, &u, &at, (record.start_s, rate * steps as f64))
    }

    /// Runs step by step with one value of each input for a step.
    fn stepped(
        &mut self,
        values: &[f64],
        u: &[Vec<f64>],
        at: &AtPorts,
        (t0, rate): (f64, f64),
    ) -> Result<Channels, SimulatorError> {
        let ports = 0..self.responses.len();
        let mut couplings: Vec<(Coupling, usize)> = ports
            .filter(|port| at.laws.iter().any(|(p, _)| p == port) || at.loads.iter().any(|(p, _)| p == port))
            .map(|port| {
                let laws = at.laws.iter().filter(|(p, _)| *p == port).map(|(_, law)| *law).collect();
                let loads: Vec<Load> = at.loads.iter().filter(|(p, _)| *p == port).map(|(_, load)| *load).collect();
                (Coupling::new(self.responses[port], laws, &loads), port)
            })
            .collect();
        self.simulator.run_with(values, u, |step, motions, forces| {
            forces.fill(0.0);
            let t = t0 + step as f64 / rate;
            for (port, push) in &at.pushes {
                forces[*port] += push(t);
            }
            for (coupling, port) in &mut couplings {
                forces[*port] = coupling.force(motions[*port], forces[*port]);
            }
        })
    }

    /// Runs step by step with these forces, and returns outputs and the motions after each step.
    pub fn watched(
        simulator: &mut Checked<'_>,
        u: &[Vec<f64>],
        mut force: impl FnMut(usize, &mut [f64]),
    ) -> Result<(Channels, Vec<Vec<Motion>>), SimulatorError> {
        let (values, steps) = (simulator.description().values(), simulator.description().steps_per_sample);
        let held: Channels =
            u.iter().map(|u| u.iter().flat_map(|u| std::iter::repeat_n(*u, steps)).collect()).collect();
        let mut motions = Vec::new();
        let y = simulator.run_with(&values, &held, |step, motion, forces| {
            motions.push(motion.to_vec());
            force(step, forces);
        })?;
        Ok((y, motions))
    }
}

fn written(placed: &Placed, setting: &Setting) -> Written {
    (placed.effect.name().into(), placed.place.location(&setting.names), placed.parameters.clone())
}

/// Returns the command with so many values in a sample: the means over its parts, or the parts repeated.
fn regrouped(drive: &Drive, values: usize) -> Channels {
    let one = |u: &Vec<f64>| -> Vec<f64> {
        let samples = u.len() / drive.parts;
        // In units of a sample, value j lasts from j / values to (j + 1) / values.
        let mean = |sample: usize, j: usize| {
            let [from, to] = [j, j + 1].map(|j| j as f64 * drive.parts as f64 / values as f64);
            let (first, last) = (from.floor() as usize, (to.ceil() as usize).min(drive.parts));
            let within = |part: usize| (to.min(part as f64 + 1.0) - from.max(part as f64)).max(0.0);
            let sum: f64 = (first..last).map(|part| within(part) * u[sample * drive.parts + part]).sum();
            sum / (to - from)
        };
        (0..samples).flat_map(|sample| (0..values).map(move |j| (sample, j))).map(|(s, j)| mean(s, j)).collect()
    };
    drive.u.iter().map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_is_averaged_over_each_value() {
        let drive = Drive { parts: 4, u: vec![vec![1.0, 2.0, 3.0, 4.0, 5.0, 5.0, 5.0, 5.0]], rate: 1.0, t0: 0.0 };
        assert_eq!(regrouped(&drive, 1), [[2.5, 5.0]]);
        assert_eq!(regrouped(&drive, 2), [[1.5, 3.5, 5.0, 5.0]]);
        assert_eq!(regrouped(&drive, 8)[0][..8], [1.0, 1.0, 2.0, 2.0, 3.0, 3.0, 4.0, 4.0]);
        let thirds = regrouped(&drive, 3);
        assert!((thirds[0][0] - (1.0 + 2.0 / 3.0) / (4.0 / 3.0)).abs() < 1e-12, "{thirds:?}");
    }
}
