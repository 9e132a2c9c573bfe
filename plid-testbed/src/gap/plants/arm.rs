//! An arm of two links in a plane, with a motor, an elastic joint and an angle sensor at the base and at the elbow. In
//! the angles of the joints, with J1 and J2 for the inertias of the links about their joints,
//! M = [J1 + J2, J2; J2, J2].

use std::f64::consts::TAU;

use nalgebra::{DMatrix, DVector};
use rand::RngExt;
use rand_chacha::ChaCha12Rng;

use super::Layout;
use crate::axes::{Axes, Shown};
use crate::gap::rig::{Rig, axis_rate_hz};

/// Inertia of the outer link over that of the inner one.
const OUTER: std::ops::Range<f64> = 0.3..0.7;
/// Stiffness of the elbow over that of the base.
const ELBOW: std::ops::Range<f64> = 0.4..1.2;
/// Frequency of the lower mode over the sample rate.
const FREQUENCY: std::ops::Range<f64> = 0.006..0.012;
/// Damping ratio of the lower mode; that of a higher one grows with its frequency.
const DAMPING_RATIO: std::ops::Range<f64> = 0.015..0.04;
/// Cut-off of the commands over the frequency of the higher mode.
const BAND: std::ops::Range<f64> = 1.1..1.5;

pub(super) fn layout(rng: &mut ChaCha12Rng) -> Layout {
    let rate_hz = axis_rate_hz(rng);
    let inertia = inertia(rng);
    let elbow = rng.random_range(ELBOW);
    let stiffness = DMatrix::from_diagonal(&DVector::from_vec(vec![1.0, elbow]));
    let [lower, higher] = frequencies(&inertia, &stiffness);
    let frequency = rng.random_range(FREQUENCY);
    let w = TAU * frequency * rate_hz;
    let stiffness = stiffness * (w / lower).powi(2);
    // C = (2 zeta / w) K gives the lower mode the ratio zeta.
    let damping = &stiffness * (2.0 * rng.random_range(DAMPING_RATIO) / w);
    let axes = Axes { inertia, damping, stiffness, drive: vec![1.0; 2], shown: Shown::Position };
    let band = frequency * higher / lower * rng.random_range(BAND);
    Layout::of_axes(axes, Rig::of_axes(rate_hz, band, rng))
}

/// Draws the inertia of an arm whose inner link has an inertia of one.
pub(super) fn inertia(rng: &mut ChaCha12Rng) -> DMatrix<f64> {
    let outer = rng.random_range(OUTER);
    DMatrix::from_row_slice(2, 2, &[1.0 + outer, outer, outer, outer])
}

/// Returns the natural frequencies of two coordinates, rad/s, the lower one first: det(K - w^2 M) = 0.
fn frequencies(inertia: &DMatrix<f64>, stiffness: &DMatrix<f64>) -> [f64; 2] {
    let (m, k) = (inertia, stiffness);
    let a = m.determinant();
    let b = m[(0, 0)] * k[(1, 1)] + m[(1, 1)] * k[(0, 0)] - 2.0 * m[(0, 1)] * k[(0, 1)];
    let root = (b * b - 4.0 * a * k.determinant()).sqrt();
    [(b - root) / (2.0 * a), (b + root) / (2.0 * a)].map(f64::sqrt)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    /// Compares the closed form with the poles of the model, and checks the order of the frequencies and the band.
    #[test]
    fn its_modes_are_those_that_were_drawn() {
        for seed in 0..20 {
            let Layout { plant, rig, .. } = layout(&mut ChaCha12Rng::seed_from_u64(seed));
            let axes = plant.axes.unwrap();
            let [lower, higher] = frequencies(&axes.inertia, &axes.stiffness);
            let poles = axes.model(plant.poles_hz).a.complex_eigenvalues();
            let sizes: Vec<f64> = poles.iter().map(|pole| pole.norm()).collect();
            for w in [lower, higher] {
                assert!(sizes.iter().any(|size| (size / w - 1.0).abs() < 1e-9), "seed {seed}: {w} in {sizes:?}");
            }
            assert!(poles.iter().all(|pole| pole.re < 0.0 && -pole.re / pole.norm() < 0.25), "{poles}");
            let higher_hz = higher / TAU;
            assert!(higher_hz < rig.band_hz && rig.band_hz < 0.2 * rig.sample_rate_hz, "seed {seed}: {rig:?}");
        }
    }
}
