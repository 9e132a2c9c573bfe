//! Inertias in a row on shafts, of which the first is also held from outside: the torsion of a gearbox, with all
//! quantities referred to the drive shaft.

use nalgebra::{DMatrix, DVector, SymmetricEigen};
use rand::RngExt;
use rand_chacha::ChaCha12Rng;

use super::{Layout, about};
use crate::structure::{Mode, ModeGroup};

/// Inertias from the motor to the load. The ratio of a stage divides what follows by its square, and the wheels of a
/// stage are heavy.
const INERTIAS: [f64; 7] = [1.0, 0.6, 0.4, 1.2, 0.5, 0.8, 1.5];
/// Relative standard deviation of each inertia and of the stiffness of each shaft.
const SCATTER: f64 = 0.1;
/// Value about which the lowest frequency is drawn, Hz.
const FIRST_HZ: f64 = 24.0;
/// Inertias at which torques act and accelerations are measured. The two of each pair are one shaft apart.
const DRIVEN: [usize; 3] = [0, 2, 5];
const MEASURED: [usize; 3] = [1, 3, 6];

pub(super) fn layout(rng: &mut ChaCha12Rng) -> Layout {
    let inertias = INERTIAS.map(|inertia| about(inertia, SCATTER, rng));
    let shafts = INERTIAS.map(|_| about(1.0, SCATTER, rng));
    let (rates, shapes) = eigen(&inertias, &shafts);
    let first_hz = about(FIRST_HZ, 0.03, rng);
    let modes = (0..INERTIAS.len())
        .map(|m| Mode {
            frequency_hz: first_hz * rates[m] / rates[0],
            damping_ratio: rng.random_range(0.008..0.02),
            input_shape: DRIVEN.map(|i| shapes[(i, m)]),
            output_shape: MEASURED.map(|i| shapes[(i, m)]),
            group: ModeGroup::Dominant,
        })
        .collect();
    Layout::new(modes, 1..5, 1..5)
}

/// Returns the natural frequencies in rad/s, lowest first, and the shapes in the columns, each of unit modal inertia.
/// `shafts[i]` is the stiffness between inertia i - 1, or the outside, and inertia i.
fn eigen(inertias: &[f64], shafts: &[f64]) -> (Vec<f64>, DMatrix<f64>) {
    let n = inertias.len();
    let mut stiffness = DMatrix::zeros(n, n);
    for i in 0..n {
        stiffness[(i, i)] += shafts[i];
        if i > 0 {
            stiffness[(i - 1, i - 1)] += shafts[i];
            stiffness[(i - 1, i)] -= shafts[i];
            stiffness[(i, i - 1)] -= shafts[i];
        }
    }
    let root = DMatrix::from_diagonal(&DVector::from_iterator(n, inertias.iter().map(|j| 1.0 / j.sqrt())));
    let SymmetricEigen { eigenvalues, eigenvectors } = SymmetricEigen::new(&root * stiffness * &root);
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|a, b| eigenvalues[*a].total_cmp(&eigenvalues[*b]));
    let shapes = root * eigenvectors.select_columns(&order);
    (order.iter().map(|m| eigenvalues[*m].sqrt()).collect(), shapes)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use rand::SeedableRng;

    /// For n equal inertias and shafts, w_m = 2 sin((2 m - 1) pi / (2 (2 n + 1))), and the shape at inertia i is
    /// proportional to sin((2 m - 1) pi i / (2 n + 1)).
    #[test]
    fn a_uniform_chain_has_the_modes_of_the_closed_form() {
        let n = 7;
        let (rates, shapes) = eigen(&vec![1.0; n], &vec![1.0; n]);
        for m in 0..n {
            let angle = (2 * m + 1) as f64 * PI / (2 * n + 1) as f64;
            assert!((rates[m] - 2.0 * (angle / 2.0).sin()).abs() < 1e-12);
            let unit = (2.0 / (n as f64 + 0.5)).sqrt();
            let sign = shapes[(0, m)].signum();
            for i in 0..n {
                let expected = unit * ((i + 1) as f64 * angle).sin();
                assert!((sign * shapes[(i, m)] - expected).abs() < 1e-12, "{m}, {i}");
            }
        }
    }

    /// At rest, all modes together give the compliance of the shafts up to each inertia. The frequencies of a drawn
    /// chain are in order.
    #[test]
    fn its_compliance_is_that_of_the_shafts_in_series() {
        let (inertias, shafts) = ([1.0, 0.3, 2.0], [0.5, 4.0, 1.5]);
        let (rates, shapes) = eigen(&inertias, &shafts);
        for i in 0..3 {
            let found: f64 = (0..3).map(|m| (shapes[(i, m)] / rates[m]).powi(2)).sum();
            let expected: f64 = shafts[..=i].iter().map(|k| 1.0 / k).sum();
            assert!((found - expected).abs() < 1e-12);
        }
        let modes = layout(&mut ChaCha12Rng::seed_from_u64(1)).plant.modes;
        assert!(modes.windows(2).all(|w| w[0].frequency_hz < w[1].frequency_hz));
    }
}
