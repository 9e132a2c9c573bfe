//! Random models and matrices for tests, reproducible from a seed.
use nalgebra::DMatrix;
use ndarray::Array2;

use super::state_space::Model;

/// Returns uniform numbers between -1 and 1 from splitmix64, so that no test depends on a library's generator.
pub fn numbers(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15);
    move || {
        state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^= z >> 31;
        (z >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
}

/// Returns a matrix of uniform numbers between -1 and 1.
pub fn random(seed: u64, rows: usize, columns: usize) -> DMatrix<f64> {
    let mut next = numbers(seed);
    DMatrix::from_fn(rows, columns, |_, _| next())
}

/// Returns a record (samples x channels) of uniform numbers between -1 and 1.
pub fn record(seed: u64, samples: usize, channels: usize) -> Array2<f64> {
    let next = numbers(seed);
    Array2::from_shape_simple_fn((samples, channels), next)
}

/// Returns a random positive definite matrix.
pub fn covariance(seed: u64, size: usize) -> DMatrix<f64> {
    let root = random(seed, size, size);
    &root * root.transpose() / size as f64 + DMatrix::identity(size, size) * 0.1
}

/// Returns a stable random model in observable canonical form, sampled at 100 Hz.
pub fn canonical(seed: u64, indices: &[usize], m: usize) -> Model {
    let (n, p) = (indices.iter().sum::<usize>(), indices.len());
    let mut a = DMatrix::zeros(n, n);
    let mut c = DMatrix::zeros(p, n);
    let columns = random(seed, n, p);
    let mut last = 0;
    for (i, &size) in indices.iter().enumerate() {
        for row in last + 1..last + size {
            a[(row, row - 1)] = 1.0;
        }
        last += size;
        c[(i, last - 1)] = 1.0;
        // Small columns keep every pole well inside the unit circle.
        for row in 0..n {
            a[(row, last - 1)] += columns[(row, i)] * 0.6 / n as f64;
        }
    }
    let b = random(seed + 77, n, m);
    let mut model = Model::new(100.0, a, b, c, DMatrix::zeros(p, m)).unwrap();
    model.observability_indices = Some(indices.to_vec());
    model
}

/// Returns two lightly damped modes (12 and 31 Hz, sampled at 100 Hz) with two inputs and two outputs.
pub fn two_modes() -> Model {
    let mut a = DMatrix::zeros(4, 4);
    for (i, (hz, damping)) in [(12.0, 0.01), (31.0, 0.004)].into_iter().enumerate() {
        let (radius, angle) = pole(hz, damping, 100.0);
        let (re, im) = (radius * angle.cos(), radius * angle.sin());
        a[(2 * i, 2 * i)] = re;
        a[(2 * i, 2 * i + 1)] = im;
        a[(2 * i + 1, 2 * i)] = -im;
        a[(2 * i + 1, 2 * i + 1)] = re;
    }
    let b = random(5, 4, 2);
    let c = random(6, 2, 4);
    Model::new(100.0, a, b, c, DMatrix::zeros(2, 2)).unwrap()
}

/// Returns the radius and angle of the discrete pole with a given natural frequency and damping ratio.
pub fn pole(hz: f64, damping: f64, rate: f64) -> (f64, f64) {
    let omega = std::f64::consts::TAU * hz / rate;
    ((-damping * omega).exp(), omega * (1.0 - damping * damping).sqrt())
}

/// Returns the same model with states x' = T x for a random T, and T.
pub fn in_other_states(model: &Model, seed: u64) -> (Model, DMatrix<f64>) {
    let n = model.n();
    let change = DMatrix::identity(n, n) + random(seed, n, n) * (0.5 / n as f64);
    let back = change.clone().try_inverse().unwrap();
    let mut other = model.clone();
    other.a = &change * &model.a * &back;
    other.b = &change * &model.b;
    other.c = &model.c * &back;
    (other, change)
}
