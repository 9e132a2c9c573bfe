//! One instance of a simulator, whose answers are checked.

use std::sync::Arc;

use crate::{Channels, Description, Motion, Simulator, SimulatorError};

/// An instance of a simulator. Its answers are checked.
pub struct Instance<'a> {
    simulator: Box<dyn Simulator + 'a>,
    description: Arc<Description>,
    y: Vec<f64>,
    motions: Vec<Motion>,
}

/// The failure of a run, and the sample at which it happened if the run was stepped.
#[derive(Debug)]
pub struct Failure {
    /// The sample, from 0.
    pub sample: Option<usize>,
    /// The failure itself.
    pub source: SimulatorError,
}

impl<'a> Instance<'a> {
    pub(crate) fn new(simulator: Box<dyn Simulator + 'a>, description: Arc<Description>) -> Self {
        let (y, motions) = (vec![0.0; description.outputs.len()], vec![Motion::default(); description.ports.len()]);
        Self { simulator, description, y, motions }
    }

    /// Returns the simulator itself.
    pub(crate) fn simulator(&mut self) -> &mut (dyn Simulator + 'a) {
        self.simulator.as_mut()
    }

    /// Runs from rest; see [`Simulator::run`].
    ///
    /// # Errors
    /// Returns the [`Failure`] of the simulator, or that of a check of its answer.
    pub fn run(&mut self, parameters: &[f64], u: &[Vec<f64>]) -> Result<Channels, Failure> {
        let samples = u.first().map_or(0, Vec::len);
        let y = self.simulator.run(parameters, u).and_then(|y| self.checked(y, samples));
        y.map_err(|source| Failure { sample: None, source })
    }

    /// Runs from rest, step by step. `u` holds one value of each input for each step, so that an input may change
    /// within a sample. `force` computes the forces at the ports: it is called before each step with the index of the
    /// step and the motions (one for each port), and writes the forces. Returns the outputs at the samples.
    ///
    /// # Errors
    /// Returns the [`Failure`] of the simulator, or that of a check of its answer, with the sample.
    pub fn run_with(
        &mut self,
        parameters: &[f64],
        u: &[Vec<f64>],
        mut force: impl FnMut(usize, &[Motion], &mut [f64]),
    ) -> Result<Channels, Failure> {
        let at = |sample: usize| move |source: SimulatorError| Failure { sample: Some(sample), source };
        let steps = self.description.steps_per_sample.max(1);
        let samples = u.first().map_or(0, Vec::len) / steps;
        let mut y = vec![vec![0.0; samples]; self.description.outputs.len()];
        let (mut held, mut forces) = (vec![0.0; u.len()], vec![0.0; self.description.ports.len()]);
        let started = self.simulator.start(parameters).map_err(at(0))?;
        if started.len() != self.motions.len() {
            let (expected, found) = (self.motions.len(), started.len());
            let of = |count: usize| format!("the motion at {count} ports");
            return Err(at(0)(SimulatorError::Shape { expected: of(expected), found: of(found) }));
        }
        self.motions.copy_from_slice(&started);
        for k in 0..samples {
            for step in 0..steps {
                held.iter_mut().zip(u).for_each(|(held, u)| *held = u[k * steps + step]);
                force(k * steps + step, &self.motions, &mut forces);
                self.simulator.step(&held, &forces, &mut self.y, &mut self.motions).map_err(at(k))?;
                if step == 0 {
                    y.iter_mut().zip(&self.y).for_each(|(y, now)| y[k] = *now);
                }
            }
            self.finite(k).map_err(at(k))?;
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
}
