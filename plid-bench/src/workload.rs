//! The workload of the benches: the simulated truss, and a recursion that goes over its record again and again.

use plid_core::{NoiseModel, ObservableForm, Settings};
use plid_lab::variant::{Recursion, Variant, VariantError};
use plid_testbed::{INPUTS, OUTPUTS, TestbedError, TrussConfig, simulate};

/// A record of the truss (3 x 3), and what an identification of it starts from.
#[derive(Clone, Debug)]
pub struct Workload {
    /// The canonical form.
    pub form: ObservableForm,
    /// The noise covariances, those of the testbed's sensors and amplifiers, in V^2.
    pub noise: NoiseModel,
    /// The start.
    pub settings: Settings,
    /// K samples of m inputs, V.
    pub inputs: Vec<[f64; INPUTS]>,
    /// K samples of p outputs, V.
    pub outputs: Vec<[f64; OUTPUTS]>,
}

/// A workload that cannot be had.
#[derive(Debug, thiserror::Error)]
pub enum WorkloadError {
    /// The number of states is impossible.
    #[error(transparent)]
    Structure(#[from] plid_core::StructureError),
    /// The truss cannot be simulated.
    #[error(transparent)]
    Testbed(#[from] TestbedError),
}

impl Workload {
    /// `duration_s` seconds of the default truss, to be identified with `states` states.
    ///
    /// # Errors
    /// [`WorkloadError`]
    pub fn truss(states: usize, duration_s: f64) -> Result<Self, WorkloadError> {
        let form = ObservableForm::balanced(states, OUTPUTS, INPUTS)?;
        let config = TrussConfig { duration_s, ..TrussConfig::default() };
        let simulation = simulate(&config)?;
        let sensor = simulation.truth.noise.sensor.diagonal();
        let actuator = simulation.truth.noise.actuator.diagonal();
        Ok(Self {
            noise: NoiseModel::diagonal(sensor.as_slice(), actuator.as_slice(), &vec![1e-6; states]),
            settings: Settings::new(&form, 1.0, 1.0),
            inputs: simulation.commands.rows().into_iter().map(|row| std::array::from_fn(|j| row[j])).collect(),
            outputs: simulation.outputs[0].rows().into_iter().map(|row| std::array::from_fn(|i| row[i])).collect(),
            form,
        })
    }

    /// The recursion of `variant`, before its first sample.
    ///
    /// # Errors
    /// [`VariantError`]
    pub fn recursion(&self, variant: Variant) -> Result<Loop<'_>, VariantError> {
        let recursion = variant.build(self.form.clone(), &self.noise, &self.settings)?;
        Ok(Loop { workload: self, recursion, next: 0 })
    }
}

/// A recursion that begins the record anew, with its estimate as it stands, whenever it is through.
pub struct Loop<'a> {
    workload: &'a Workload,
    recursion: Box<dyn Recursion>,
    next: usize,
}

impl Loop<'_> {
    /// Takes the next sample.
    ///
    /// # Errors
    /// As [`plid_core::Identifier::step`].
    pub fn step(&mut self) -> Result<(), plid_core::IdentifierError> {
        let k = self.next;
        self.next = (k + 1) % self.workload.inputs.len();
        self.recursion.step(&self.workload.outputs[k], &self.workload.inputs[k], false)
    }

    /// The recursion.
    pub fn recursion(&self) -> &dyn Recursion {
        self.recursion.as_ref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_loop_goes_on_over_the_records_end() {
        let workload = Workload::truss(12, 0.05).unwrap();
        assert_eq!(workload.inputs.len(), 80);
        let mut steps = workload.recursion(Variant::default()).unwrap();
        for _ in 0..81 {
            steps.step().unwrap();
        }
        // Sample 0 has come twice: the first innovation is the output itself, the second that less a prediction.
        let innovation = steps.recursion().innovation()[0];
        assert!(innovation.is_finite() && innovation != workload.outputs[0][0]);
        assert!(steps.recursion().health().smallest_pivot > 0.0);
    }

    #[test]
    fn fewer_states_than_outputs_are_refused() {
        assert!(matches!(Workload::truss(2, 0.05), Err(WorkloadError::Structure(_))));
    }
}
