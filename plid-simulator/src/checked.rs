use std::time::{Duration, Instant};

use crate::{Channels, Description, Motion, Simulator, SimulatorError};

/// How often a simulator was called, and for how long.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Calls {
    /// Number of runs, those step by step included.
    pub runs: usize,
    /// Time that they took.
    pub time: Duration,
}

/// A simulator whose answers are checked and whose calls are counted.
pub struct Checked<'a> {
    simulator: &'a mut dyn Simulator,
    description: Description,
    calls: Calls,
    y: Vec<f64>,
    motions: Vec<Motion>,
}

impl<'a> Checked<'a> {
    /// Wraps a simulator.
    ///
    /// # Errors
    /// [`SimulatorError::Description`] if the simulator's description is inconsistent.
    pub fn new(simulator: &'a mut dyn Simulator) -> Result<Self, SimulatorError> {
        let description = simulator.description().clone();
        description.check()?;
        let (y, motions) = (vec![0.0; description.outputs.len()], vec![Motion::default(); description.ports.len()]);
        Ok(Self { simulator, description, calls: Calls::default(), y, motions })
    }

    /// Returns what the simulator has.
    pub fn description(&self) -> &Description {
        &self.description
    }

    /// Returns the number of calls so far and their time.
    pub fn calls(&self) -> Calls {
        self.calls
    }

    /// Runs from rest; see [`Simulator::run`].
    ///
    /// # Errors
    /// [`SimulatorError::Call`] with the number of the run and its failure.
    pub fn run(&mut self, parameters: &[f64], u: &[Vec<f64>]) -> Result<Channels, SimulatorError> {
        let began = Instant::now();
        let result = self.simulator.run(parameters, u);
        self.count(began);
        let samples = u.first().map_or(0, Vec::len);
        result.and_then(|y| self.checked(y, samples)).map_err(|source| self.called("", source))
    }

    /// Runs from rest, step by step. `u` holds one value of each input for each step, so that an input may change
    /// within a sample. `force` gives the force at each port from the motion there: it is called before each step with
    /// the step's number and the motions (one for each port), and writes the forces. Returns the outputs at the
    /// samples.
    ///
    /// # Errors
    /// [`SimulatorError::Call`] with the number of the run, the sample and the failure.
    pub fn run_with(
        &mut self,
        parameters: &[f64],
        u: &[Vec<f64>],
        force: impl FnMut(usize, &[Motion], &mut [f64]),
    ) -> Result<Channels, SimulatorError> {
        let began = Instant::now();
        let result = self.stepped(parameters, u, force);
        self.count(began);
        result.map_err(|(sample, source)| self.called(&format!(", sample {sample}"), source))
    }

    fn stepped(
        &mut self,
        parameters: &[f64],
        u: &[Vec<f64>],
        mut force: impl FnMut(usize, &[Motion], &mut [f64]),
    ) -> Result<Channels, (usize, SimulatorError)> {
        let steps = self.description.steps_per_sample.max(1);
        let samples = u.first().map_or(0, Vec::len) / steps;
        let mut y = vec![vec![0.0; samples]; self.description.outputs.len()];
        let (mut held, mut forces) = (vec![0.0; u.len()], vec![0.0; self.description.ports.len()]);
        let started = self.simulator.start(parameters).map_err(|source| (0, source))?;
        if started.len() != self.motions.len() {
            let (expected, found) = (self.motions.len(), started.len());
            let of = |count: usize| format!("the motion at {count} ports");
            return Err((0, SimulatorError::Shape { expected: of(expected), found: of(found) }));
        }
        self.motions.copy_from_slice(&started);
        for k in 0..samples {
            for step in 0..steps {
                held.iter_mut().zip(u).for_each(|(held, u)| *held = u[k * steps + step]);
                force(k * steps + step, &self.motions, &mut forces);
                self.simulator.step(&held, &forces, &mut self.y, &mut self.motions).map_err(|source| (k, source))?;
                if step == 0 {
                    y.iter_mut().zip(&self.y).for_each(|(y, now)| y[k] = *now);
                }
            }
            self.finite(k).map_err(|source| (k, source))?;
        }
        Ok(y)
    }

    /// Checks the outputs of the last step and the motions after it.
    fn finite(&self, sample: usize) -> Result<(), SimulatorError> {
        if let Some(o) = self.y.iter().position(|y| !y.is_finite()) {
            let what = format!("output {:?}", self.description.outputs[o].name);
            return Err(SimulatorError::NotFinite { what, sample, value: self.y[o] });
        }
        let unsound = |motion: &Motion| !(motion.displacement.is_finite() && motion.velocity.is_finite());
        let Some(j) = self.motions.iter().position(unsound) else { return Ok(()) };
        let what = format!("the motion at port {:?}", self.description.ports[j].name);
        let Motion { displacement, velocity } = self.motions[j];
        let value = if displacement.is_finite() { velocity } else { displacement };
        Err(SimulatorError::NotFinite { what, sample, value })
    }

    fn checked(&self, y: Channels, samples: usize) -> Result<Channels, SimulatorError> {
        let p = self.description.outputs.len();
        let shape =
            |found: String| SimulatorError::Shape { expected: format!("{p} outputs of {samples} samples"), found };
        if y.len() != p {
            return Err(shape(format!("{} outputs", y.len())));
        }
        for (channel, output) in y.iter().zip(&self.description.outputs) {
            if channel.len() != samples {
                return Err(shape(format!("{} samples of output {:?}", channel.len(), output.name)));
            }
            if let Some(sample) = channel.iter().position(|y| !y.is_finite()) {
                let what = format!("output {:?}", output.name);
                return Err(SimulatorError::NotFinite { what, sample, value: channel[sample] });
            }
        }
        Ok(y)
    }

    fn count(&mut self, began: Instant) {
        self.calls.runs += 1;
        self.calls.time += began.elapsed();
    }

    fn called(&self, at: &str, source: SimulatorError) -> SimulatorError {
        let call = format!("run {} of simulator {:?}{at}", self.calls.runs, self.description.name);
        SimulatorError::Call { call, source: Box::new(source) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Function, Input, Output};

    fn description() -> Description {
        Description::new("sim", 10.0, vec![Input::new("u")], vec![Output::new("a"), Output::new("b")])
    }

    /// Returns the message of the second run of a simulator that answers with these outputs.
    fn refused(answer: Channels) -> String {
        let sound = vec![vec![0.0; 3]; 2];
        let mut again = false;
        let mut simulator = Function::new(description(), |_: &[f64], _: &[Vec<f64>]| {
            Ok(if std::mem::replace(&mut again, true) { answer.clone() } else { sound.clone() })
        });
        let mut checked = Checked::new(&mut simulator).unwrap();
        let u = vec![vec![1.0; 3]];
        checked.run(&[], &u).unwrap();
        checked.run(&[], &u).unwrap_err().to_string()
    }

    #[test]
    fn a_wrong_answer_names_the_call() {
        let missing = refused(vec![vec![0.0; 3]]);
        assert_eq!(
            missing,
            "run 2 of simulator \"sim\": the simulator returned 1 outputs, expected 2 outputs of 3 samples"
        );
        let short = refused(vec![vec![0.0; 3], vec![0.0; 2]]);
        assert!(short.contains("2 samples of output \"b\""), "{short}");
        let unsound = refused(vec![vec![0.0; 3], vec![0.0, f64::NAN, 0.0]]);
        assert!(unsound.ends_with("NaN for output \"b\" at sample 1"), "{unsound}");
    }

    #[test]
    fn a_description_that_contradicts_itself_is_refused() {
        let faulty = |change: &dyn Fn(&mut Description)| {
            let mut description = description();
            change(&mut description);
            description.check().unwrap_err().to_string()
        };
        assert!(faulty(&|d| d.rate_hz = 0.0).contains("rate_hz"));
        assert!(faulty(&|d| d.outputs[1].name = "a".into()).contains("\"a\" is not unique"));
        assert!(faulty(&|d| d.ports.push(crate::Port::new("joint"))).contains("steps_per_sample"));
        let outside = crate::Parameter { upper: Some(1.0), ..crate::Parameter::new("k", 2.0) };
        assert!(faulty(&|d| d.parameters.push(outside.clone())).contains("2 is not within -inf to 1"));
    }
}
