//! What a simulator does not honour.

use serde::Serialize;

use crate::{Channels, Checked, Motion, Simulator, SimulatorError};

/// One thing that was checked.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// What was checked, in a few words.
    pub what: String,
    /// Whether a diagnosis needs it.
    pub required: bool,
    /// Whether the simulator honours it.
    pub holds: bool,
    /// What was found, in a sentence.
    pub found: String,
}

/// Number of samples of a trial run.
const SAMPLES: usize = 200;

/// Relative difference below which two runs are one.
const SAME: f64 = 1e-9;

/// Relative change of a parameter.
const CHANGE: f64 = 0.05;

/// Relative difference between a velocity and the change of the displacement, over the size of the velocity.
const KINEMATIC: f64 = 0.2;

/// Checks a simulator with trial inputs of this size.
///
/// # Errors
/// [`SimulatorError`] if it cannot be run at all.
pub fn check(simulator: &mut dyn Simulator, size: f64) -> Result<Vec<Finding>, SimulatorError> {
    let mut simulator = Checked::new(simulator)?;
    let description = simulator.description().clone();
    let u = trial(description.inputs.len(), SAMPLES, size);
    let values = description.values();
    let y = simulator.run(&values, &u)?;
    let mut findings = Vec::new();
    let mut add = |what: &str, required: bool, holds: bool, found: String| {
        findings.push(Finding { what: what.into(), required, holds, found });
    };

    let again = simulator.run(&values, &u)?;
    let apart = difference(&y, &again);
    add("repeats", true, apart == 0.0, format!("two equal runs differ by {apart:.1e} of the outputs"));

    let none = vec![vec![0.0; SAMPLES]; u.len()];
    let rest = largest(&simulator.run(&values, &none)?);
    add("rests", false, rest == 0.0, format!("without an input the outputs reach {rest:.1e}"));
    let answers = difference(&y, &simulator.run(&values, &none)?);
    add("answers", true, answers > 0.0, format!("an input changes the outputs by {answers:.1e} of themselves"));

    for (k, parameter) in description.parameters.iter().enumerate() {
        let mut changed = values.clone();
        let unit = if parameter.value == 0.0 { 1.0 } else { parameter.value.abs() };
        changed[k] = parameter.bounded(parameter.value + CHANGE * unit);
        if changed[k] == parameter.value {
            changed[k] = parameter.bounded(parameter.value - CHANGE * unit);
        }
        let what = format!("parameter {}", parameter.name);
        match simulator.run(&changed, &u) {
            Ok(moved) => {
                let apart = difference(&y, &moved);
                add(&what, true, apart > 0.0, format!("{} instead of {} changes {apart:.1e}", changed[k], values[k]));
            }
            Err(error) => add(&what, true, false, error.to_string()),
        }
    }
    if description.has_steps() {
        stepped(&mut simulator, &u, &y, &mut add)?;
    }
    Ok(findings)
}

/// Checks the steps: without forces they are a run, a force moves its port, and velocities belong to displacements.
fn stepped(
    simulator: &mut Checked<'_>,
    u: &Channels,
    y: &Channels,
    add: &mut dyn FnMut(&str, bool, bool, String),
) -> Result<(), SimulatorError> {
    let description = simulator.description().clone();
    let (steps, values) = (description.steps_per_sample, description.values());
    let fine: Channels = u.iter().map(|u| u.iter().flat_map(|u| std::iter::repeat_n(*u, steps)).collect()).collect();
    let mut motions: Vec<Vec<Motion>> = Vec::new();
    let by_steps = simulator.run_with(&values, &fine, |_, now, forces| {
        forces.fill(0.0);
        motions.push(now.to_vec());
    })?;
    let apart = difference(y, &by_steps);
    add("steps", true, apart < SAME, format!("steps without forces differ from a run by {apart:.1e} of the outputs"));
    let step = 1.0 / (description.rate_hz * steps as f64);
    for (j, port) in description.ports.iter().enumerate() {
        let speed = motions.iter().map(|all| all[j].velocity.abs()).fold(0.0, f64::max);
        let wrong = motions.windows(2).map(|two| {
            let [from, to] = [two[0][j], two[1][j]];
            let change = (to.displacement - from.displacement) / step;
            // Between the velocities at both ends of the step, whatever the integrator.
            let (low, high) = (from.velocity.min(to.velocity), from.velocity.max(to.velocity));
            (low - change).max(change - high).max(0.0)
        });
        let wrong = wrong.fold(0.0, f64::max);
        let holds = wrong <= KINEMATIC * speed;
        let what = format!("motion at {}", port.name);
        add(
            &what,
            true,
            holds,
            format!("velocity and change of displacement differ by {wrong:.1e} of up to {speed:.1e}"),
        );
        let none = vec![vec![0.0; 2 * steps]; u.len()];
        let mut velocity = |force: f64| -> Result<f64, SimulatorError> {
            let mut last = 0.0;
            simulator.run_with(&values, &none, |step, now, forces| {
                forces.fill(0.0);
                forces[j] = if step == 0 { force } else { 0.0 };
                last = now[j].velocity;
            })?;
            Ok(last)
        };
        let still = velocity(0.0)?;
        let mut size = 1e-6;
        let mut moved = 0.0;
        while moved == 0.0 && size < 1e9 {
            moved = velocity(size)? - still;
            size *= 10.0;
        }
        let what = format!("force at {}", port.name);
        add(&what, true, moved > 0.0, format!("a force changes the velocity there by {moved:.1e}"));
    }
    Ok(())
}

/// A trial input: steps of both signs, other ones for each channel.
fn trial(m: usize, samples: usize, size: f64) -> Channels {
    let sign = |i: usize, k: usize| if (k / 10 * (2 * i + 3)).is_multiple_of(5) { -1.0 } else { 1.0 };
    (0..m).map(|i| (0..samples).map(|k| size * sign(i, k)).collect()).collect()
}

fn largest(y: &Channels) -> f64 {
    y.iter().flatten().map(|y| y.abs()).fold(0.0, f64::max)
}

/// Largest difference over the largest output.
fn difference(a: &Channels, b: &Channels) -> f64 {
    let apart = a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    apart / largest(a).max(f64::MIN_POSITIVE)
}
