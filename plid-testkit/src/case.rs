//! Random plants, noise models and records, by seed.

use nalgebra::DMatrix;
use plid_core::{Dense, InitialCovariance, NoiseModel, ObservableForm, Settings};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::reference::joint_covariance;

/// A structure, a record, and the settings of the identifier.
#[derive(Clone, Debug)]
pub struct Case {
    /// Observability indices.
    pub indices: Vec<usize>,
    /// The number of inputs.
    pub inputs: usize,
    /// The plant that made the record.
    pub plant: Plant,
    /// One noise model for all steps, or several in turn, fifty steps each.
    pub noise: Vec<NoiseModel>,
    /// The settings of the start.
    pub settings: Settings,
    /// Outputs, sample by sample; NaN for a missing output.
    pub z: Vec<Vec<f64>>,
    /// Inputs, sample by sample.
    pub u: Vec<Vec<f64>>,
}

impl Case {
    /// Returns the noise model of step `k`.
    pub fn noise_at(&self, k: usize) -> &NoiseModel {
        &self.noise[k / 50 % self.noise.len()]
    }

    /// Returns the number of states.
    pub fn states(&self) -> usize {
        self.indices.iter().sum()
    }
}

/// The plant x+ = A x + B u in the canonical form, in which output i is the last state of block i.
#[derive(Clone, Debug)]
pub struct Plant {
    /// A, n x n.
    pub a: DMatrix<f64>,
    /// B, n x m.
    pub b: DMatrix<f64>,
    /// The state that each output reads.
    pub outputs: Vec<usize>,
}

impl Plant {
    /// Draws a plant with spectral radius `radius` and random entries of B and of the columns of A.
    pub fn random(indices: &[usize], inputs: usize, radius: f64, rng: &mut ChaCha8Rng) -> Self {
        Self::with_entries(indices, inputs, radius, rng, |_, _| true)
    }

    /// Draws such a plant with a_i zero in the rows of block j from the (n_i + 1)-th on; see
    /// `ObservableForm::is_redundant`.
    pub fn random_unique(indices: &[usize], inputs: usize, radius: f64, rng: &mut ChaCha8Rng) -> Self {
        let form = ObservableForm::new(indices, inputs).unwrap();
        Self::with_entries(indices, inputs, radius, rng, |row, output| !form.is_redundant(row, output))
    }

    fn with_entries(
        indices: &[usize],
        inputs: usize,
        radius: f64,
        rng: &mut ChaCha8Rng,
        there: impl Fn(usize, usize) -> bool,
    ) -> Self {
        let n = indices.iter().sum();
        let mut outputs = Vec::new();
        let mut lag = Vec::new();
        for &size in indices {
            lag.extend((0..size).rev().map(|d| d as i32 + 1));
            outputs.push(lag.len() - 1);
        }
        let mut a = DMatrix::<f64>::zeros(n, n);
        for i in 1..n {
            // A new block begins after the state of each output.
            if !outputs.contains(&(i - 1)) {
                a[(i, i - 1)] = 1.0;
            }
        }
        for (output, &column) in outputs.iter().enumerate() {
            for row in 0..n {
                let entry = normal(rng);
                a[(row, column)] += if there(row, output) { entry } else { 0.0 };
            }
        }
        // An entry for a delay of d samples scales with the d-th power of the factor, so all eigenvalues are
        // multiplied by the same factor.
        let largest = a.complex_eigenvalues().iter().map(|z| z.norm()).fold(0.0, f64::max);
        for &column in &outputs {
            for row in 0..n {
                a[(row, column)] *= (radius / largest).powi(lag[row]);
            }
        }
        let b = DMatrix::from_fn(n, inputs, |_, _| normal(rng));
        Self { a, b, outputs }
    }
}

/// Draws a standard normal number.
pub fn normal(rng: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(rng)
}

/// Returns the generator for a seed.
pub fn rng(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}

/// Draws a joint covariance of [w; v; xi] with standard deviations near `scale`.
pub fn random_noise(p: usize, m: usize, n: usize, scale: f64, rng: &mut ChaCha8Rng) -> NoiseModel {
    let size = p + m + n;
    let columns = size + 4;
    let w = DMatrix::from_fn(size, columns, |_, _| scale * normal(rng) / (columns as f64).sqrt());
    let joint = &w * w.transpose();
    let part = |row: usize, column: usize, rows: usize, columns: usize| {
        Dense::from_fn(rows, columns, |i, j| joint[(row + i, column + j)])
    };
    NoiseModel {
        sensor: part(0, 0, p, p),
        actuator: part(p, p, m, m),
        state: part(p + m, p + m, n, n),
        actuator_sensor: part(p, 0, m, p),
        sensor_state: part(0, p + m, p, n),
        actuator_state: part(p, p + m, m, n),
    }
}

/// Records the plant under a white input of unit variance, with noise according to the models in turn.
pub fn record(
    plant: &Plant,
    noise: &[NoiseModel],
    steps: usize,
    rng: &mut ChaCha8Rng,
) -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
    let (n, m, p) = (plant.a.nrows(), plant.b.ncols(), plant.outputs.len());
    let roots: Vec<DMatrix<f64>> = noise
        .iter()
        .map(|model| {
            let joint = joint_covariance(model);
            let joint = DMatrix::from_fn(joint.rows, joint.rows, |i, j| joint[(i, j)]);
            let eigen = joint.symmetric_eigen();
            &eigen.eigenvectors * DMatrix::from_diagonal(&eigen.eigenvalues.map(|x| x.max(0.0).sqrt()))
        })
        .collect();
    let mut x = DMatrix::zeros(n, 1);
    let (mut zs, mut us) = (Vec::new(), Vec::new());
    for k in 0..steps {
        let eta = &roots[k / 50 % roots.len()] * DMatrix::from_fn(p + m + n, 1, |_, _| normal(rng));
        let u: Vec<f64> = (0..m).map(|_| normal(rng)).collect();
        zs.push((0..p).map(|i| x[plant.outputs[i]] + eta[i]).collect());
        let driven = DMatrix::from_fn(m, 1, |j, _| u[j] + eta[p + j]);
        x = &plant.a * x + &plant.b * driven + eta.rows(p + m, n);
        us.push(u);
    }
    (zs, us)
}

/// Properties that vary between cases.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Number of samples.
    pub steps: usize,
    /// Approximate standard deviation of the noise.
    pub noise_scale: f64,
    /// Number of noise models, which alternate every fifty steps.
    pub noise_models: usize,
    /// The probability that an output is missing.
    pub missing: f64,
    /// Whether P0 is a full matrix.
    pub full_initial: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self { steps: 200, noise_scale: 0.2, noise_models: 1, missing: 0.0, full_initial: false }
    }
}

/// Draws a case of the given structure.
pub fn random_case(indices: &[usize], inputs: usize, options: Options, seed: u64) -> Case {
    let mut rng = rng(seed);
    let (p, n) = (indices.len(), indices.iter().sum());
    let plant = Plant::random(indices, inputs, 0.9, &mut rng);
    let noise: Vec<_> =
        (0..options.noise_models).map(|_| random_noise(p, inputs, n, options.noise_scale, &mut rng)).collect();
    let (mut z, u) = record(&plant, &noise, options.steps, &mut rng);
    for entry in z.iter_mut().flatten() {
        if rng.random::<f64>() < options.missing {
            *entry = f64::NAN;
        }
    }
    let form = ObservableForm::new(indices, inputs).unwrap();
    let mut settings = Settings::new(&form, 1.0, 0.25);
    let size = settings.initial_estimate.len();
    if options.full_initial {
        let w = DMatrix::from_fn(size, size + 4, |_, _| 0.5 * normal(&mut rng) / (size as f64).sqrt());
        let p0 = &w * w.transpose();
        settings.initial_covariance = InitialCovariance::Full(Dense::from_fn(size, size, |i, j| p0[(i, j)]));
        settings.initial_estimate = (0..size).map(|_| 0.1 * normal(&mut rng)).collect();
    }
    Case { indices: indices.to_vec(), inputs, plant, noise, settings, z, u }
}
