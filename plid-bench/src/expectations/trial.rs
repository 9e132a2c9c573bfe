//! One run of a study: a record, the assumptions about it, and the truth.

use ndarray::Array2;
use plid_core::{Dense, IdentifiedModel, ImplicitModel, NoiseModel, ObservableForm, Settings};
use plid_identify::{Samples, free_run_error};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// A record, the assumptions of an estimate, and the truth against which it is judged.
#[derive(Clone, Debug)]
pub struct Trial {
    /// The canonical form.
    pub form: ObservableForm,
    /// Samples x m.
    pub inputs: Array2<f64>,
    /// Samples x p.
    pub outputs: Array2<f64>,
    /// The noise covariances that the recursion assumes.
    pub told: NoiseModel,
    /// The true noise covariances, if the plant is in the model class.
    pub true_noise: Option<NoiseModel>,
    /// The initial estimate and P0.
    pub settings: Settings,
    /// The true parameters [a_1; ..; a_p; b_1; ..; b_m], if the plant is in the model class.
    pub truth: Option<Vec<f64>>,
    /// Inputs of another record (samples x m), and the true plant's response to them from rest without any noise
    /// (samples x p).
    pub held_out: (Array2<f64>, Array2<f64>),
}

impl Trial {
    /// Returns the RMS of the error of a model's free run from rest over the RMS of the true response, for inputs
    /// that no estimate has used.
    pub fn free_run_error(&self, parameters: &[f64]) -> f64 {
        let (n, joint) = (self.form.states(), self.form.joint_states());
        let mut s = vec![0.0; n];
        s.extend_from_slice(parameters);
        let model = IdentifiedModel::from_estimate(&self.form, &s, &Dense::from_diagonal(&vec![0.0; joint]));
        let (inputs, outputs) = (self.held_out.0.view(), self.held_out.1.view());
        free_run_error(&model, &self.form, Samples { inputs, outputs, nan_is_missing: false })
    }
}

/// The plant x+ = A x + B (u + v) + xi, z = C x + w in canonical form, with Q = 0 and independent noises.
#[derive(Clone, Debug)]
pub struct InClass {
    /// The canonical form.
    pub form: ObservableForm,
    /// The parameters [a_1; ..; a_p; b_1; ..; b_m].
    pub parameters: Vec<f64>,
    /// Variance of the noise of each sensor.
    pub sensor: f64,
    /// Variance of the noise of each state.
    pub state: f64,
}

impl InClass {
    /// Returns the outputs (samples x p) for `inputs` from the state `x`. `normal` gives noise of unit variance, for
    /// each sample first that of the sensors and then that of the states.
    pub fn simulate(&self, inputs: &Array2<f64>, mut x: Vec<f64>, normal: &mut dyn FnMut() -> f64) -> Array2<f64> {
        let (n, p) = (self.form.states(), self.form.outputs());
        let mut outputs = Array2::zeros((inputs.nrows(), p));
        for (mut z, u) in outputs.rows_mut().into_iter().zip(inputs.rows()) {
            let y: Vec<f64> = self.form.output_states().iter().map(|&row| x[row]).collect();
            for (z, y) in z.iter_mut().zip(&y) {
                *z = y + self.sensor.sqrt() * normal();
            }
            self.form.shift(&mut x);
            for (column, &by) in self.parameters.chunks_exact(n).zip(y.iter().chain(u)) {
                x.iter_mut().zip(column).for_each(|(x, c)| *x += by * c);
            }
            x.iter_mut().for_each(|x| *x += self.state.sqrt() * normal());
        }
        outputs
    }

    /// Returns R, and Sigma multiplied by `factor`.
    pub fn noise(&self, factor: f64) -> NoiseModel {
        let (n, m, p) = (self.form.states(), self.form.inputs(), self.form.outputs());
        NoiseModel::diagonal(&vec![self.sensor; p], &vec![0.0; m], &vec![factor * self.state; n])
    }

    /// Returns the response from rest without noise.
    pub fn response(&self, inputs: &Array2<f64>) -> Array2<f64> {
        let quiet = Self { sensor: 0.0, state: 0.0, ..self.clone() };
        quiet.simulate(inputs, vec![0.0; self.form.states()], &mut || 0.0)
    }
}

/// Draws a number from the standard normal distribution.
pub fn normal(rng: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(rng)
}

/// Draws `samples` x `channels` values of white noise of unit variance.
pub fn white(rng: &mut ChaCha8Rng, samples: usize, channels: usize) -> Array2<f64> {
    Array2::from_shape_simple_fn((samples, channels), || normal(rng))
}
