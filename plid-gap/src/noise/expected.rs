//! The expected periodogram of a record of finite length.

use nalgebra::DMatrix;

use plid_fourier::{C, backward, forward};

/// Returns the expected periodogram, at the bins 0 to length/2, of noise with a spectral density (p x p, a function
/// of the frequency in Hz). It is the density smoothed by the transform of the record's window, and is computed from
/// the covariances (Sykulski, Olhede, Guillaumin, Lilly and Early, *Biometrika* 106, 2019).
///
/// A controller suppresses slow noise by many orders of magnitude, but not the leakage from the ends of a record of
/// finite length.
pub fn periodograms(density: impl Fn(f64) -> DMatrix<C>, rate: f64, length: usize) -> Vec<DMatrix<C>> {
    let doubled = 2 * length;
    let lines: Vec<DMatrix<C>> = (0..=length).map(|k| density(k as f64 * rate / doubled as f64)).collect();
    let p = lines.first().map_or(0, DMatrix::nrows);
    let mut expected = vec![DMatrix::zeros(p, p); length / 2 + 1];
    for (i, j) in (0..p).flat_map(|i| (0..=i).map(move |j| (i, j))) {
        let entries: Vec<C> = lines.iter().map(|line| line[(i, j)]).collect();
        let mut covariances = backward(&entries, doubled);
        for (lag, covariance) in covariances.iter_mut().enumerate() {
            *covariance *= 1.0 - lag.min(doubled - lag) as f64 / length as f64;
        }
        for (to, smooth) in expected.iter_mut().zip(forward(&covariances).into_iter().step_by(2)) {
            (to[(i, j)], to[(j, i)]) = (smooth, smooth.conj());
        }
    }
    expected
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    /// Differences of white noise: the covariances are 2, -1 and 0, whose weights are 1 and 1 - 1/N.
    #[test]
    fn differences_of_white_noise_leak_at_zero() {
        let n = 60;
        let density = |hz: f64| DMatrix::from_element(1, 1, C::from(2.0 - 2.0 * (TAU * hz).cos()));
        for (k, found) in periodograms(density, 1.0, n).iter().enumerate() {
            let expected = 2.0 - 2.0 * (1.0 - 1.0 / n as f64) * (TAU * k as f64 / n as f64).cos();
            assert!((found[(0, 0)] - expected).norm() < 1e-12, "{k}");
        }
    }
}
