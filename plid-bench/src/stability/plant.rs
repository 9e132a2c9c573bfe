//! A plant of the model's own class with n states in observable canonical form and random parameters. It has a true
//! parameter vector with which a stated accuracy can be compared.
//!
//! The truss cannot serve: it has 59 states.

use ndarray::Array2;
use plid_core::{Dense, IdentifiedModel, ImplicitModel, ObservableForm, StructureError};
use plid_identify::ToModel;
use plid_model::{Model, ModelError, stability};
use plid_testbed::{INPUTS, OUTPUTS};
use rand_chacha::ChaCha12Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

use super::record::{Check, Record, STATE_NOISE};

/// Noise of each sensor and of each actuator in V RMS, as in the default truss.
const NOISE_RMS: f64 = 0.005;
/// The largest magnitude of an eigenvalue of A.
const RADIUS: f64 = 0.97;
/// RMS of an output for white inputs of unit RMS, about that of the truss.
const OUTPUT_RMS: f64 = 0.45;
const CHECK_SAMPLES: usize = 4096;
const RATE_HZ: f64 = 1600.0;

/// The reasons why a plant cannot be created.
#[derive(Debug, thiserror::Error)]
pub enum PlantError {
    /// The number of states is impossible.
    #[error(transparent)]
    Structure(#[from] StructureError),
    /// With unequal indices, some parameters are not unique, so there is no single true parameter vector.
    #[error("{0} states cannot be shared out equally over {OUTPUTS} outputs, so the true parameters are not unique")]
    Unequal(usize),
    /// The poles of the plant could not be computed.
    #[error(transparent)]
    Model(#[from] ModelError),
}

/// A plant in canonical form.
#[derive(Clone, Debug)]
pub struct Plant {
    form: ObservableForm,
    parameters: Vec<f64>,
}

fn normal(rng: &mut ChaCha12Rng) -> f64 {
    StandardNormal.sample(rng)
}

impl Plant {
    /// Creates a random stable plant with `states` states. The same number always gives the same plant.
    ///
    /// # Errors
    /// Returns a [`PlantError`].
    pub fn random(states: usize) -> Result<Self, PlantError> {
        if !states.is_multiple_of(OUTPUTS) {
            return Err(PlantError::Unequal(states));
        }
        let form = ObservableForm::balanced(states, OUTPUTS, INPUTS)?;
        let mut rng = ChaCha12Rng::seed_from_u64(states as u64);
        let parameters = (0..form.parameter_columns() * states).map(|_| normal(&mut rng)).collect();
        let mut plant = Self { form, parameters };
        // The new parameters are those of A multiplied by `shrink`, after a diagonal change of the states, so all
        // eigenvalues are multiplied by this factor.
        let shrink = RADIUS / stability(&plant.model()?)?.spectral_radius;
        let order = states / OUTPUTS;
        for (k, a) in plant.parameters[..OUTPUTS * states].iter_mut().enumerate() {
            *a *= shrink.powi((order - k % order) as i32);
        }
        let inputs = plant.inputs(CHECK_SAMPLES, 1);
        let outputs = plant.run(&inputs, None);
        let power = outputs.iter().flatten().map(|y| y * y).sum::<f64>() / (outputs.len() * OUTPUTS) as f64;
        plant.parameters[OUTPUTS * states..].iter_mut().for_each(|b| *b *= OUTPUT_RMS / power.sqrt());
        Ok(plant)
    }

    /// Returns the same plant with the first column of B increased by half.
    pub fn jumped(&self) -> Self {
        let mut other = self.clone();
        let n = self.form.states();
        other.parameters[OUTPUTS * n..(OUTPUTS + 1) * n].iter_mut().for_each(|b| *b *= 1.5);
        other
    }

    /// Returns A, B and C as a model.
    fn model(&self) -> Result<Model, ModelError> {
        let s: Vec<f64> = vec![0.0; self.form.states()].into_iter().chain(self.parameters.iter().copied()).collect();
        let found = IdentifiedModel::from_estimate(&self.form, &s, &Dense::<f64>::from_diagonal(&[]));
        found.to_model(RATE_HZ)
    }

    fn rng(&self, stream: u64) -> ChaCha12Rng {
        let mut rng = ChaCha12Rng::seed_from_u64(self.form.states() as u64);
        rng.set_stream(1 + stream);
        rng
    }

    /// Returns white inputs of unit RMS.
    fn inputs(&self, samples: usize, stream: u64) -> Vec<[f64; INPUTS]> {
        let mut rng = self.rng(stream);
        (0..samples).map(|_| std::array::from_fn(|_| normal(&mut rng))).collect()
    }

    /// Simulates the outputs from rest; `noise` adds the noise of sensors, actuators and states, and replaces the
    /// plant by another one from sample `at` on.
    fn run(
        &self,
        inputs: &[[f64; INPUTS]],
        mut noise: Option<(&mut ChaCha12Rng, usize, &Self)>,
    ) -> Vec<[f64; OUTPUTS]> {
        let n = self.form.states();
        let mut x = vec![0.0; n];
        let mut outputs = Vec::with_capacity(inputs.len());
        for (k, u) in inputs.iter().enumerate() {
            let y: [f64; OUTPUTS] = std::array::from_fn(|i| x[self.form.output_states()[i]]);
            let plant = match &noise {
                Some((_, at, other)) if k >= *at => other,
                _ => self,
            };
            self.form.shift(&mut x);
            let (mut z, mut u) = (y, *u);
            if let Some((rng, ..)) = &mut noise {
                z.iter_mut().for_each(|z| *z += NOISE_RMS * normal(rng));
                u.iter_mut().for_each(|u| *u += NOISE_RMS * normal(rng));
                x.iter_mut().for_each(|x| *x += STATE_NOISE.sqrt() * normal(rng));
            }
            for (column, &weight) in plant.parameters.chunks_exact(n).zip(y.iter().chain(&u)) {
                plid_core::kernels::axpy(weight, column, &mut x);
            }
            outputs.push(z);
        }
        outputs
    }

    /// Returns a record of this plant up to sample `at`, and of `other` from then on. The true parameters and the
    /// check of the record are those of `other`.
    pub fn record(&self, samples: usize, at: usize, other: &Self) -> Record {
        let inputs = self.inputs(samples, 2);
        let outputs = self.run(&inputs, Some((&mut self.rng(3), at, other)));
        let check = self.inputs(CHECK_SAMPLES, 4);
        let expected = other.run(&check, None);
        let array = |rows: &[[f64; 3]]| Array2::from_shape_fn((rows.len(), 3), |(k, i)| rows[k][i]);
        let record = Record {
            inputs,
            outputs,
            sensor: NOISE_RMS * NOISE_RMS,
            actuator: NOISE_RMS * NOISE_RMS,
            truth: Some(other.parameters.clone()),
            check: Check {
                inputs: array(&check),
                outputs: array(&expected),
                rate_hz: RATE_HZ,
                band_hz: [2.0, RATE_HZ / 2.0],
            },
        };
        record.rounded()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_plant_is_stable_with_moderate_parameters() {
        for states in [6, 24, 48] {
            let plant = Plant::random(states).unwrap();
            let radius = stability(&plant.model().unwrap()).unwrap().spectral_radius;
            assert!((radius - RADIUS).abs() < 1e-9, "{radius}");
            assert!(plant.parameters.iter().all(|p| p.abs() < 5.0));
            let record = plant.record(2000, 2000, &plant);
            let power = record.outputs.iter().flatten().map(|z| z * z).sum::<f64>() / 6000.0;
            assert!((power.sqrt() / OUTPUT_RMS - 1.0).abs() < 0.15, "{}", power.sqrt());
        }
        assert!(matches!(Plant::random(64), Err(PlantError::Unequal(64))));
    }

    #[test]
    fn the_run_is_that_of_the_model() {
        let plant = Plant::random(9).unwrap();
        let inputs = plant.inputs(50, 7);
        let found = plant.run(&inputs, None);
        let model = plant.model().unwrap();
        let array = Array2::from_shape_fn((50, INPUTS), |(k, j)| inputs[k][j]);
        let expected = plid_model::simulate(&model, array.view(), &model.rest()).unwrap().outputs;
        for k in 0..50 {
            for i in 0..OUTPUTS {
                assert!((found[k][i] - expected[(k, i)]).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn a_jump_changes_one_column_and_the_outputs_after_it() {
        let plant = Plant::random(6).unwrap();
        let other = plant.jumped();
        let (one, two) = (plant.record(100, 100, &plant), plant.record(100, 50, &other));
        assert_eq!(one.inputs, two.inputs);
        assert_eq!(one.outputs[..=50], two.outputs[..=50]);
        assert!(one.outputs[52..] != two.outputs[52..]);
        let changed = plant.parameters.iter().zip(&other.parameters).filter(|(a, b)| a != b).count();
        assert_eq!(changed, 6);
        assert_eq!(two.truth.unwrap(), other.parameters);
    }
}
