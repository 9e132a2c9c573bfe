//! Runs of the engineer's own simulator with effects around it and at its ports.

use std::time::Instant;

use plid_simulator::{Calls, Checked, Description, Failure, Instance, Motion, SimulatorError};

use crate::answer::schema::Bound;
use crate::case::record::{Channels, Record};
use crate::effects::{Action, Drive, Force, Memory, Sampling, Setting};
use crate::fit::problem::Placed;
use crate::in_loop::bounds::{Bounds, Cut, Spent};
use crate::in_loop::coupling::{Coupling, Response};
use crate::plant::Load;

/// Largest number of runs that are kept for reuse.
const REMEMBERED: usize = 256;

/// The simulator, with the responses of its ports and the runs that are kept for reuse.
pub(super) struct Runs<'s> {
    simulator: Checked<'s>,
    responses: Vec<Response>,
    remembered: Vec<Remembered>,
    rest: Option<Rest>,
    bounds: Bounds,
    spent: Spent,
    cut: Option<Cut>,
}

/// The outputs (p) of a simulator that stays at rest without inputs.
struct Rest {
    outputs: Vec<f64>,
}

/// A run before the effects of the sensors.
struct Remembered {
    record: String,
    samples: usize,
    effects: Vec<Written>,
    y: Channels,
}

/// Name, location and parameters of an effect that reaches the simulator.
type Written = (String, String, Vec<f64>);

/// The actions at the simulator's ports in one run.
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

    /// Returns the laws and loads at each port that has any.
    fn couplings(&self, responses: &[Response]) -> Vec<(Coupling<'_>, usize)> {
        let acts = |port: &usize| self.laws.iter().any(|(p, _)| p == port) || self.loads.iter().any(|(p, _)| p == port);
        let one = |port: usize| {
            let laws = self.laws.iter().filter(|(p, _)| *p == port).map(|(_, law)| *law).collect();
            let loads: Vec<Load> = self.loads.iter().filter(|(p, _)| *p == port).map(|(_, load)| *load).collect();
            (Coupling::new(responses[port], laws, &loads), port)
        };
        (0..responses.len()).filter(acts).map(one).collect()
    }
}

/// The actions of effects in a run.
struct Acting {
    actions: Vec<Action>,
    /// The effects that reach the simulator.
    inside: Vec<Written>,
}

impl Acting {
    fn new(setting: &Setting, effects: &[Placed]) -> Self {
        let (mut actions, mut inside) = (Vec::new(), Vec::new());
        for placed in effects {
            let own = placed.effect.act(setting, &placed.place, &placed.parameters);
            if !own.iter().all(|action| matches!(action, Action::Sensor(_))) {
                inside.push(written(placed, setting));
            }
            actions.extend(own);
        }
        Self { actions, inside }
    }

    /// Applies the effects of the sensors to outputs.
    fn sense(&self, y: &mut Channels, t0: f64, rate: f64) {
        // A simulator may begin at any position.
        let sampling = Sampling { t0, rate, at_rest: false };
        for action in &self.actions {
            if let Action::Sensor(sensor) = action {
                sensor.apply(y, sampling, &mut Memory::default());
            }
        }
    }
}

/// A run that is ready to be carried out.
struct Prepared<'p> {
    record: &'p Record,
    inside: &'p [Written],
    /// Values of the simulator's parameters.
    values: Vec<f64>,
    drive: Drive,
    at: AtPorts<'p>,
}

impl Prepared<'_> {
    /// Runs the simulator as a whole, or step by step if a command changes within a sample or something acts at a
    /// port.
    fn run(&self, instance: &mut Instance, steps: usize, responses: &[Response]) -> Result<Channels, Failure> {
        if self.at.is_empty() && (self.drive.parts == 1 || steps < 2) {
            return instance.run(&self.values, &regrouped(&self.drive, 1));
        }
        instance.run_with(&self.values, &regrouped(&self.drive, steps), self.forces(steps, responses))
    }

    /// Returns the function that computes the forces at the ports before each step.
    fn forces(&self, steps: usize, responses: &[Response]) -> impl FnMut(usize, &[Motion], &mut [f64]) {
        let mut couplings = self.at.couplings(responses);
        let rate = self.drive.rate * steps as f64;
        move |step, motions, forces| {
            forces.fill(0.0);
            let t = self.record.start_s + step as f64 / rate;
            for (port, push) in &self.at.pushes {
                forces[*port] += push(t);
            }
            for (coupling, port) in &mut couplings {
                forces[*port] = coupling.force(motions[*port], forces[*port]);
            }
        }
    }
}

/// The source of the outputs of a run.
enum Source {
    Known(Channels),
    /// A run that is carried out, with its index.
    New(usize),
}

fn remember(remembered: &mut Vec<Remembered>, prepared: &Prepared, y: &Channels) {
    if remembered.len() == REMEMBERED {
        // The first runs are those without effects, which are needed until the end.
        remembered.remove(REMEMBERED / 2);
    }
    let (record, samples) = (prepared.record.name.clone(), prepared.record.samples());
    remembered.push(Remembered { record, samples, effects: prepared.inside.to_vec(), y: y.clone() });
}

impl<'s> Runs<'s> {
    /// Wraps a simulator whose ports have these responses.
    pub fn new(simulator: Checked<'s>, responses: Vec<Response>) -> Self {
        let calls = simulator.calls();
        let spent = Spent { runs: calls.runs, seconds: calls.time.as_secs_f64(), timed: (0, 0.0) };
        Self { simulator, responses, remembered: Vec::new(), rest: None, bounds: Bounds::NONE, spent, cut: None }
    }

    /// Sets the bounds of a search. Only [`Runs::may`] observes them; a run itself is never refused.
    pub fn bind(&mut self, bounds: Bounds) {
        self.bounds = bounds;
    }

    /// Returns the bounds.
    pub fn bounds(&self) -> Bounds {
        self.bounds
    }

    /// Returns the runs so far.
    pub fn spent(&self) -> Spent {
        self.spent
    }

    /// Returns what was left out because of the bounds.
    pub fn cut(&self) -> Option<&Cut> {
        self.cut.as_ref()
    }

    /// Returns whether `needed` further runs, of `samples` samples each, are within the bounds. If they are not,
    /// `what` is recorded as left out.
    pub fn may(&mut self, needed: usize, samples: usize, what: impl FnOnce() -> String) -> bool {
        let (left, by) = self.bounds.left(self.spent, samples);
        if needed > left {
            self.leave_out(by, what());
        }
        needed <= left
    }

    /// Records what is left out because of a bound.
    pub fn leave_out(&mut self, by: Bound, what: String) {
        let cut = self.cut.get_or_insert_with(|| Cut { by, what: Vec::new() });
        if !cut.what.contains(&what) {
            cut.what.push(what);
        }
    }

    /// Determines from a run without effects whether the simulator stays at rest: all inputs are zero, no output
    /// changes, and the ports start at zero displacement and velocity. Such a run is not repeated with effects that
    /// do nothing at rest. `start` is the motion of the ports at the start.
    pub fn learn_rest(&mut self, record: &Record, y: &[Vec<f64>], start: &[Motion]) {
        let still = |y: &Vec<f64>| y.iter().all(|value| *value == y[0]);
        let moved = record.u.iter().flatten().any(|u| *u != 0.0);
        if !moved && record.samples() > 1 && y.iter().all(still) && start.iter().all(|at| *at == Motion::default()) {
            self.rest = Some(Rest { outputs: y.iter().map(|y| y[0]).collect() });
        }
    }

    /// Returns the outputs of a run in which nothing can move the simulator.
    fn resting(&self, Prepared { drive, values, at, .. }: &Prepared) -> Option<Channels> {
        let rest = self.rest.as_ref()?;
        let driven = drive.u.iter().flatten().any(|u| *u != 0.0);
        let acts = |(_, law): &(usize, &dyn Force)| {
            let mut state = vec![0.0; law.states()];
            law.advance(0.0, 0.0, &mut state);
            state.iter().any(|state| *state != 0.0) || law.force(0.0, 0.0, &state) != 0.0
        };
        if driven || !at.pushes.is_empty() || at.laws.iter().any(acts) || *values != self.description().values() {
            return None;
        }
        let samples = drive.u.first().map_or(0, Vec::len) / drive.parts;
        Some(rest.outputs.iter().map(|y| vec![*y; samples]).collect())
    }

    /// Returns the description of the simulator.
    pub fn description(&self) -> &Description {
        self.simulator.description()
    }

    /// Returns the number of runs so far and their time.
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
        self.simulate_all(setting, &[(effects, record)]).remove(0)
    }

    /// Returns the outputs (p channels) for the inputs of a record, with effects, and the peak displacement at each
    /// port from its position at rest. A simulator with ports is run step by step.
    ///
    /// # Errors
    /// [`SimulatorError`] if the simulator fails.
    pub fn simulate_with_motion(
        &mut self,
        setting: &Setting,
        effects: &[Placed],
        record: &Record,
    ) -> Result<(Channels, Vec<f64>), SimulatorError> {
        let ports = self.description().ports.len();
        if ports == 0 {
            return Ok((self.simulate(setting, effects, record)?, Vec::new()));
        }
        let acting = Acting::new(setting, effects);
        let prepared = self.prepared(&acting, record, setting.plant.rate);
        let mut peaks = vec![0.0_f64; ports];
        let mut y = if let Some(y) = self.resting(&prepared) {
            y
        } else {
            let mut rest: Option<Vec<Motion>> = None;
            self.stepped(&prepared, |_, motions, _| {
                let rest = rest.get_or_insert_with(|| motions.to_vec());
                for (peak, (now, rest)) in peaks.iter_mut().zip(motions.iter().zip(rest)) {
                    *peak = peak.max((now.displacement - rest.displacement).abs());
                }
            })?
        };
        acting.sense(&mut y, record.start_s, setting.plant.rate);
        Ok((y, peaks))
    }

    /// Returns the outputs (p channels) for the inputs of a record, with effects, and the motions of the ports before
    /// each step. `added` contains the signals that are added to the inputs, followed by those that are added to the
    /// forces at the ports (m + q channels).
    ///
    /// # Errors
    /// [`SimulatorError`] if the simulator fails.
    pub fn pushed(
        &mut self,
        setting: &Setting,
        effects: &[Placed],
        record: &Record,
        added: &[Vec<f64>],
    ) -> Result<(Channels, Vec<Vec<Motion>>), SimulatorError> {
        let acting = Acting::new(setting, effects);
        let mut prepared = self.prepared(&acting, record, setting.plant.rate);
        let parts = prepared.drive.parts;
        let (inputs, forces) = added.split_at(prepared.drive.u.len());
        for (u, added) in prepared.drive.u.iter_mut().zip(inputs) {
            u.iter_mut().enumerate().for_each(|(k, u)| *u += added[k / parts]);
        }
        let (steps, mut seen) = (self.description().steps_per_sample.max(1), Vec::new());
        let mut y = if forces.is_empty() {
            self.carried_out(&[prepared]).remove(0)?
        } else {
            self.stepped(&prepared, |step, motions, applied| {
                seen.push(motions.to_vec());
                applied.iter_mut().zip(forces).for_each(|(applied, force)| *applied += force[step / steps]);
            })?
        };
        acting.sense(&mut y, record.start_s, setting.plant.rate);
        Ok((y, seen))
    }

    /// Returns the command of a record with effects.
    pub fn drive(&self, setting: &Setting, effects: &[Placed], record: &Record) -> Drive {
        self.prepared(&Acting::new(setting, effects), record, setting.plant.rate).drive
    }

    /// Carries out a run step by step. `see` receives the number of the step, the motions before it and the forces of
    /// the effects, to which it may add.
    fn stepped(
        &mut self,
        prepared: &Prepared,
        mut see: impl FnMut(usize, &[Motion], &mut [f64]),
    ) -> Result<Channels, SimulatorError> {
        let (steps, began) = (self.description().steps_per_sample, Instant::now());
        let mut forces = prepared.forces(steps, &self.responses);
        let u = regrouped(&prepared.drive, steps);
        let y = self.simulator.run_with(&prepared.values, &u, |step, motions, applied| {
            forces(step, motions, applied);
            see(step, motions, applied);
        });
        drop(forces);
        // A run that fails takes time, too.
        self.count(y.as_ref().map_or(0, |_| prepared.record.samples()), began);
        y
    }

    /// Returns the outputs of several runs, each of a record with effects. The runs are carried out in parallel if
    /// the simulator has several instances; the results do not depend on this.
    pub fn simulate_all(
        &mut self,
        setting: &Setting,
        asked: &[(&[Placed], &Record)],
    ) -> Vec<Result<Channels, SimulatorError>> {
        let acting: Vec<Acting> = asked.iter().map(|(effects, _)| Acting::new(setting, effects)).collect();
        let mut new: Vec<Prepared> = Vec::new();
        let mut sources = Vec::new();
        for (acting, (_, record)) in acting.iter().zip(asked) {
            let same = |of: &Prepared| {
                let (name, samples) = (&of.record.name, of.record.samples());
                (name, samples) == (&record.name, record.samples()) && of.inside == acting.inside
            };
            let source = match (self.known(acting, record), new.iter().position(same)) {
                (Some(y), _) => Source::Known(y),
                (None, Some(at)) => Source::New(at),
                (None, None) => {
                    let prepared = self.prepared(acting, record, setting.plant.rate);
                    if let Some(y) = self.resting(&prepared) {
                        Source::Known(y)
                    } else {
                        new.push(prepared);
                        Source::New(new.len() - 1)
                    }
                }
            };
            sources.push(source);
        }
        let done = self.carried_out(&new);
        for (prepared, y) in new.iter().zip(&done) {
            if let Ok(y) = y {
                remember(&mut self.remembered, prepared, y);
            }
        }
        let finished = sources.into_iter().zip(acting.iter().zip(asked)).map(|(source, (acting, (_, record)))| {
            let mut y = match source {
                Source::Known(y) => y,
                Source::New(at) => done[at].clone()?,
            };
            acting.sense(&mut y, record.start_s, setting.plant.rate);
            Ok(y)
        });
        finished.collect()
    }

    /// Returns the number of runs that [`Runs::simulate_all`] would carry out.
    pub fn needed(&self, setting: &Setting, asked: &[(&[Placed], &Record)]) -> usize {
        let acting: Vec<Acting> = asked.iter().map(|(effects, _)| Acting::new(setting, effects)).collect();
        let run = |k: usize| (&asked[k].1.name, asked[k].1.samples(), &acting[k].inside);
        let takes_one = |&k: &usize| {
            let record = asked[k].1;
            let still = record.u.iter().flatten().all(|u| *u == 0.0);
            !(0..k).any(|other| run(other) == run(k))
                && self.known(&acting[k], record).is_none()
                && !(still && self.resting(&self.prepared(&acting[k], record, setting.plant.rate)).is_some())
        };
        (0..asked.len()).filter(takes_one).count()
    }

    /// Returns the outputs of an earlier run that is identical up to the sensors, if there is one.
    fn known(&self, acting: &Acting, record: &Record) -> Option<Channels> {
        let same = |known: &&Remembered| {
            known.record == record.name && known.samples == record.samples() && known.effects == acting.inside
        };
        self.remembered.iter().find(same).map(|known| known.y.clone())
    }

    /// Collects the actions of the effects in a run.
    fn prepared<'p>(&self, acting: &'p Acting, record: &'p Record, rate: f64) -> Prepared<'p> {
        let mut values = self.description().values();
        let mut drive = Drive::new(&record.u, rate, record.start_s);
        let mut at = AtPorts::default();
        for action in &acting.actions {
            match action {
                Action::Command(command) => command.apply(&mut drive, &mut Memory::default()),
                Action::Parameter(number, value) => values[*number] = *value,
                Action::Force(port, law) => at.laws.push((*port, law.as_ref())),
                Action::Load(port, load) => at.loads.push((*port, *load)),
                Action::Disturbance(port, of) => at.pushes.push((*port, of.as_ref())),
                Action::Sensor(_) | Action::Noise => {}
                Action::Plant(_) | Action::Stiffness(_) | Action::Lag(..) => {
                    unreachable!("such effects are not among the candidates")
                }
            }
        }
        Prepared { record, inside: &acting.inside, values, drive, at }
    }

    /// Carries out runs.
    fn carried_out(&mut self, all: &[Prepared]) -> Vec<Result<Channels, SimulatorError>> {
        let (steps, responses) = (self.description().steps_per_sample, self.responses.clone());
        let runs: Vec<_> = all.iter().map(|prepared| |of: &mut Instance| prepared.run(of, steps, &responses)).collect();
        let began = Instant::now();
        let done = self.simulator.all(&runs);
        let samples = done.iter().flatten().map(|y| y.first().map_or(0, Vec::len)).sum();
        self.count(samples, began);
        done
    }

    /// Counts runs that have just ended.
    fn count(&mut self, samples: usize, began: Instant) {
        let seconds = began.elapsed().as_secs_f64();
        let Spent { seconds: before, timed, .. } = self.spent;
        let timed = (timed.0 + samples, timed.1 + seconds);
        self.spent = Spent { runs: self.simulator.calls().runs, seconds: before + seconds, timed };
    }

    /// Runs the simulator step by step with these forces, and returns the outputs and the motions before each step.
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

/// Returns the command with a different number of values per sample. Values are averaged or repeated.
pub(super) fn regrouped(drive: &Drive, values: usize) -> Channels {
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
    use crate::effects::Place;
    use crate::in_loop::parameter::SimulatorParameter;
    use crate::in_loop::survey::bare;
    use crate::testing::arm::Arm;
    use crate::testing::record;

    /// A run that fails step by step counts towards the bounds: without its inertia, the link has no finite motion.
    #[test]
    fn a_run_that_fails_is_counted() {
        let mut arm = Arm::new();
        let checked = Checked::new(&mut arm).unwrap();
        let responses = vec![Response { mobility: 0.025, weight: 0.5, step: 1.0 / 800.0 }; 2];
        let setting = bare(checked.description(), &responses).unwrap();
        let parameters = SimulatorParameter::all(&checked.description().parameters);
        let place = Place::Parameter(0);
        let light = [Placed { effect: &parameters[0], place, parameters: vec![0.0] }];
        let mut runs = Runs::new(checked, responses);
        let record = record(vec![vec![1.0; 20]], vec![vec![0.0; 20]; 2]);
        let failure = runs.simulate_with_motion(&setting, &light, &record).unwrap_err().to_string();
        assert!(failure.contains("run 1"), "{failure}");
        let Spent { runs: count, seconds, timed } = runs.spent();
        assert!(count == 1 && seconds > 0.0 && timed == (0, seconds), "{:?}", runs.spent());
    }

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
