use ndarray::Array2;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Returns white Gaussian noise of unit variance, identical on every machine for the same seed.
pub(super) fn white(seed: u64, samples: usize, channels: usize) -> Array2<f64> {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    Array2::from_shape_simple_fn((samples, channels), || StandardNormal.sample(&mut generator))
}

/// Returns a first-order autoregression x_k = pole x_{k-1} + e_k of unit variance in each column.
pub(super) fn coloured(seed: u64, samples: usize, channels: usize, pole: f64) -> Array2<f64> {
    let mut data = white(seed, samples, channels);
    let gain = (1.0 - pole * pole).sqrt();
    for mut column in data.columns_mut() {
        for k in 1..samples {
            column[k] = pole * column[k - 1] + gain * column[k];
        }
    }
    data
}
