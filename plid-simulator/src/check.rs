//! Checks of a simulator against the rules of the trait.

use std::ops::Range;

use serde::Serialize;

use crate::{Channels, Checked, Description, Motion, Simulator, SimulatorError};

/// The result of one check.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// The rule that was checked, in a few words.
    pub what: String,
    /// Whether a diagnosis needs it.
    pub required: bool,
    /// Whether the simulator honours it.
    pub holds: bool,
    /// The finding, in a sentence.
    pub found: String,
}

/// Number of samples of a trial run.
const SAMPLES: usize = 200;

/// Relative difference below which two runs count as equal.
const SAME: f64 = 1e-9;

/// Relative change of a parameter.
const CHANGE: f64 = 0.05;

/// Relative difference between a velocity and the change of the displacement, over the size of the velocity.
const KINEMATIC: f64 = 0.2;

/// Checks a simulator with trial inputs of this size.
///
/// # Errors
/// Returns a [`SimulatorError`] if the simulator cannot be run at all.
pub fn check(simulator: &mut dyn Simulator, size: f64) -> Result<Vec<Finding>, SimulatorError> {
    let mut simulator = Checked::new(simulator)?;
    let description = simulator.description().clone();
    let u = trial(description.inputs.len(), SAMPLES, size);
    let y = simulator.run(&description.values(), &u)?;
    let mut trials = Trials { simulator, description, u, y, findings: Vec::new() };
    trials.repeats()?;
    trials.answers()?;
    trials.parameters();
    if trials.description.has_steps() {
        let motions = trials.steps()?;
        for port in 0..trials.description.ports.len() {
            trials.motion(port, &motions);
            trials.force(port)?;
        }
    }
    if trials.description.states {
        trials.states();
    }
    Ok(trials.findings)
}

/// A simulator that is being checked.
struct Trials<'a> {
    simulator: Checked<'a>,
    description: Description,
    /// The trial input, and the outputs for it.
    u: Channels,
    y: Channels,
    findings: Vec<Finding>,
}

impl Trials<'_> {
    fn add(&mut self, what: impl Into<String>, required: bool, holds: bool, found: String) {
        self.findings.push(Finding { what: what.into(), required, holds, found });
    }

    fn run(&mut self, u: &Channels) -> Result<Channels, SimulatorError> {
        self.simulator.run(&self.description.values(), u)
    }

    /// Returns inputs of zero for a number of samples.
    fn none(&self, samples: usize) -> Channels {
        vec![vec![0.0; samples]; self.u.len()]
    }

    /// Checks that two equal runs give equal outputs.
    fn repeats(&mut self) -> Result<(), SimulatorError> {
        let again = self.run(&self.u.clone())?;
        let apart = difference(&self.y, &again);
        self.add("repeats", true, apart == 0.0, format!("two equal runs differ by {apart:.1e} of the outputs"));
        Ok(())
    }

    /// Checks that the simulator stays at rest without an input, and that an input changes the outputs.
    fn answers(&mut self) -> Result<(), SimulatorError> {
        let quiet = self.run(&self.none(SAMPLES))?;
        let rest = largest(&quiet);
        self.add("rests", false, rest == 0.0, format!("without an input the outputs reach {rest:.1e}"));
        let moved = difference(&self.y, &quiet);
        self.add("answers", true, moved > 0.0, format!("an input changes the outputs by {moved:.1e} of themselves"));
        Ok(())
    }

    /// Checks that each parameter changes the outputs in both directions and accepts its bounds.
    fn parameters(&mut self) {
        for (k, parameter) in self.description.parameters.clone().iter().enumerate() {
            let unit = if parameter.value == 0.0 { 1.0 } else { parameter.value.abs() };
            let near = [1.0, -1.0].map(|sign| parameter.bounded(parameter.value + sign * CHANGE * unit));
            for value in near.into_iter().filter(|value| *value != parameter.value) {
                let what = format!("parameter {} = {value}", parameter.name);
                match self.changed(k, value) {
                    Ok(apart) => {
                        let found =
                            format!("{value} instead of {} changes {apart:.1e} of the outputs", parameter.value);
                        self.add(what, true, apart > 0.0, found);
                    }
                    Err(error) => self.add(what, true, false, error.to_string()),
                }
            }
            let bounds = [parameter.lower, parameter.upper].into_iter().flatten().filter(|bound| bound.is_finite());
            for bound in bounds.filter(|bound| *bound != parameter.value && !near.contains(bound)) {
                let what = format!("bound {} = {bound}", parameter.name);
                match self.changed(k, bound) {
                    Ok(_) => self.add(what, false, true, "it runs at its bound".into()),
                    Err(error) => self.add(what, false, false, error.to_string()),
                }
            }
        }
    }

    /// Returns by how much another value of a parameter changes the outputs.
    fn changed(&mut self, parameter: usize, value: f64) -> Result<f64, SimulatorError> {
        let mut values = self.description.values();
        values[parameter] = value;
        Ok(difference(&self.y, &self.simulator.run(&values, &self.u)?))
    }

    /// Returns the trial input with a value for each step.
    fn fine(&self) -> Channels {
        let steps = self.description.steps_per_sample;
        self.u.iter().map(|u| u.iter().flat_map(|u| std::iter::repeat_n(*u, steps)).collect()).collect()
    }

    /// Checks that steps without forces give the outputs of a run. Returns the motions at the ports before each step.
    fn steps(&mut self) -> Result<Vec<Vec<Motion>>, SimulatorError> {
        let mut motions: Vec<Vec<Motion>> = Vec::new();
        let by_steps = self.simulator.run_with(&self.description.values(), &self.fine(), |_, now, forces| {
            forces.fill(0.0);
            motions.push(now.to_vec());
        })?;
        let apart = difference(&self.y, &by_steps);
        let found = format!("steps without forces differ from a run by {apart:.1e} of the outputs");
        self.add("steps", true, apart < SAME, found);
        Ok(motions)
    }

    /// Checks that the velocity at a port is the derivative of its displacement.
    fn motion(&mut self, port: usize, motions: &[Vec<Motion>]) {
        let step = 1.0 / (self.description.rate_hz * self.description.steps_per_sample as f64);
        let speed = motions.iter().map(|all| all[port].velocity.abs()).fold(0.0, f64::max);
        let wrong = motions.windows(2).map(|two| {
            let [from, to] = [two[0][port], two[1][port]];
            let change = (to.displacement - from.displacement) / step;
            // The mean velocity lies between those at both ends of the step, for any integrator.
            let (low, high) = (from.velocity.min(to.velocity), from.velocity.max(to.velocity));
            (low - change).max(change - high).max(0.0)
        });
        let wrong = wrong.fold(0.0, f64::max);
        let what = format!("motion at {}", self.description.ports[port].name);
        let found = format!("velocity and change of displacement differ by {wrong:.1e} of up to {speed:.1e}");
        self.add(what, true, wrong <= KINEMATIC * speed, found);
    }

    /// Checks that a force moves its port.
    fn force(&mut self, port: usize) -> Result<(), SimulatorError> {
        let still = self.pushed(port, 0.0)?;
        let (mut size, mut moved) = (1e-6, 0.0);
        while moved == 0.0 && size < 1e9 {
            moved = self.pushed(port, size)? - still;
            size *= 10.0;
        }
        let what = format!("force at {}", self.description.ports[port].name);
        self.add(what, true, moved > 0.0, format!("a force changes the velocity there by {moved:.1e}"));
        Ok(())
    }

    /// Returns the velocity of a port after a force in the first step.
    fn pushed(&mut self, port: usize, force: f64) -> Result<f64, SimulatorError> {
        let none = self.none(2 * self.description.steps_per_sample);
        let mut last = 0.0;
        self.simulator.run_with(&self.description.values(), &none, |step, now, forces| {
            forces.fill(0.0);
            forces[port] = if step == 0 { force } else { 0.0 };
            last = now[port].velocity;
        })?;
        Ok(last)
    }

    /// Checks that a stored state comes back.
    fn states(&mut self) {
        match self.kept() {
            Ok(apart) => {
                let found = format!("after a return to a state, outputs and motions differ by {apart:.1e}");
                self.add("states", true, apart == 0.0, found);
            }
            Err(error) => self.add("states", true, false, error.to_string()),
        }
    }

    /// Returns the largest difference between the steps after a state was stored and those after it was restored.
    fn kept(&mut self) -> Result<f64, SimulatorError> {
        let (u, description) = (self.fine(), &self.description);
        let half = u.first().map_or(0, Vec::len) / 2;
        let simulator = self.simulator.simulator();
        simulator.start(&description.values())?;
        follow(simulator, description, &u, 0..half)?;
        simulator.save(0)?;
        let first = follow(simulator, description, &u, half..2 * half)?;
        simulator.save(1)?;
        let began = simulator.restore(0)?;
        let second = follow(simulator, description, &u, half..2 * half)?;
        simulator.restore(1)?;
        let again = simulator.restore(0)?;
        Ok(apart(&first, &second).max(apart(&flat(&began), &flat(&again))))
    }
}

/// Takes steps without forces, and returns all outputs and motions.
fn follow(
    simulator: &mut dyn Simulator,
    description: &Description,
    u: &Channels,
    steps: Range<usize>,
) -> Result<Vec<f64>, SimulatorError> {
    let (mut y, mut motions) = (vec![0.0; description.outputs.len()], vec![Motion::default(); description.ports.len()]);
    let forces = vec![0.0; description.ports.len()];
    let mut all = Vec::new();
    for k in steps {
        let held: Vec<f64> = u.iter().map(|u| u[k]).collect();
        simulator.step(&held, &forces, &mut y, &mut motions)?;
        all.extend_from_slice(&y);
        all.extend(flat(&motions));
    }
    Ok(all)
}

fn flat(motions: &[Motion]) -> Vec<f64> {
    motions.iter().flat_map(|motion| [motion.displacement, motion.velocity]).collect()
}

/// Returns the largest difference. It is infinite if the lengths differ or a number is NaN.
fn apart(a: &[f64], b: &[f64]) -> f64 {
    if a.len() != b.len() {
        return f64::INFINITY;
    }
    let each = a.iter().zip(b).map(|(a, b)| if a == b { 0.0 } else { (a - b).abs() });
    each.map(|apart| if apart.is_nan() { f64::INFINITY } else { apart }).fold(0.0, f64::max)
}

/// Returns a trial input: steps of both signs that differ between the channels.
fn trial(m: usize, samples: usize, size: f64) -> Channels {
    let sign = |i: usize, k: usize| if (k / 10 * (2 * i + 3)).is_multiple_of(5) { -1.0 } else { 1.0 };
    (0..m).map(|i| (0..samples).map(|k| size * sign(i, k)).collect()).collect()
}

fn largest(y: &Channels) -> f64 {
    y.iter().flatten().map(|y| y.abs()).fold(0.0, f64::max)
}

/// Returns the largest difference relative to the largest output.
fn difference(a: &Channels, b: &Channels) -> f64 {
    let apart = a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    apart / largest(a).max(f64::MIN_POSITIVE)
}
