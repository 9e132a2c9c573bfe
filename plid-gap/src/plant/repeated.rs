//! Modes with the same pole, such as the two bending modes of a symmetric mast.
//!
//! Any basis of the eigenvectors of a repeated pole satisfies the equations, but the shapes of a structure's modes are
//! real, apart from the actuators and filters. The residues of the pole from all inputs to all outputs are a matrix M,
//! which does not depend on the basis. Its largest entry, from the input i to the output o, gives the first mode: the
//! right vector is the part of B's column i that moves with the pole, and the left one that of C's row o. The mode's
//! residues are M's column i times its row o over the entry, so they are as real as M is, and as symmetric. What is
//! left of M gives the next mode (Wedderburn's rank reduction, or Gaussian elimination with complete pivoting).

use nalgebra::{DMatrix, DVector};
use plid_model::Model;

use super::{Structural, iterated, paired};
use plid_fourier::C;

/// Largest relative distance of two poles that are separated together. Inverse iteration separates more distant ones.
const SAME: f64 = 1e-6;

/// Relative distance of the shift from a pole: small compared with the distances from other poles, and large compared
/// with the rounding errors by which equal poles differ.
const SHIFT: f64 = 1e-8;

/// Largest error of an eigenvector, times the size of its counterpart. The vectors of a pole with a chain of states (a
/// Jordan block) have larger errors, and so have those that neither B nor C determines.
const SETTLED: f64 = 1e-9;

/// Residue, relative to the sizes of the input's column and the output's row, below which it is a rounding error: no
/// input drives what is left of the pole, or no output shows it.
const HIDDEN: f64 = 1e-6;

/// Returns whether two poles are the same up to rounding, or nearly so.
pub(super) fn is_same(pole: C, other: C) -> bool {
    (other - pole).norm() < SAME * pole.norm()
}

/// Returns the next pair of right and left eigenvectors of a repeated pole (l . r = 1), beside those of the `others`.
/// `None` if the pole has a chain of states, or if the inputs and outputs show no more of it.
pub(super) fn eigenvectors(model: &Model, pole: C, others: &[&Structural]) -> Option<Structural> {
    let [a, b, c] = [&model.a, &model.b, &model.c].map(|matrix| matrix.map(C::from));
    // The vectors that are known get the pole zero. The next ones are then orthogonal to them.
    let moved = |matrix: DMatrix<C>, (pole, right, left): &&Structural| matrix - right * left.transpose() * *pole;
    let left_over: DMatrix<C> = others.iter().fold(a.clone(), moved);
    let shift = pole * (1.0 + SHIFT);
    let driven = iterated(&left_over, shift, &b)?;
    let (o, i) = (&c * &driven).icamax_full();
    let shown = iterated(&left_over.transpose(), shift, &c.rows(o, 1).transpose())?;
    let (pole, right, left) = paired(&a, driven.column(i).normalize(), shown.column(0).into_owned())?;
    let error = |matrix: &DMatrix<C>, of: &DVector<C>, size: f64| (matrix * of - of * pole).norm() * size;
    let settled = error(&a, &right, left.norm()) < SETTLED && error(&a.transpose(), &left, right.norm()) < SETTLED;
    let residue = (c.rows(o, 1) * &right)[0] * left.dot(&b.column(i));
    (settled && residue.norm() > HIDDEN * c.row(o).norm() * b.column(i).norm()).then_some((pole, right, left))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant::Plant;
    use nalgebra::dmatrix;
    use plid_model::{OutputKind, frequency_response};
    use std::f64::consts::TAU;

    const RATE: f64 = 500.0;

    /// Returns oscillators of unit mass at 12, 12 and 31 Hz with a damping ratio of 0.5 %. Inputs push them by `beta`
    /// (3 x m), and outputs measure sums of their positions by `gamma` (p x 3). The second one is also pushed by
    /// `chain` times the spring force of the first one. Each state is a mixture of all positions and velocities.
    fn oscillators(beta: &DMatrix<f64>, gamma: &DMatrix<f64>, chain: f64) -> Model {
        let (m, p) = (beta.ncols(), gamma.nrows());
        let (mut a, mut b, mut c) = (DMatrix::zeros(6, 6), DMatrix::zeros(6, m), DMatrix::zeros(p, 6));
        for (k, hz) in [12.0, 12.0, 31.0].into_iter().enumerate() {
            // The states are w q and q'.
            let w = TAU * hz;
            a[(2 * k, 2 * k + 1)] = w;
            a[(2 * k + 1, 2 * k)] = -w;
            a[(2 * k + 1, 2 * k + 1)] = -0.01 * w;
            b.row_mut(2 * k + 1).copy_from(&beta.row(k));
            c.column_mut(2 * k).copy_from(&(gamma.column(k) / w));
        }
        a[(3, 0)] = chain * TAU * 12.0;
        let basis = DMatrix::from_fn(6, 6, |i, j| f64::from(i == j) + 0.2 * ((3 * i + 5 * j * j) as f64).sin());
        let inverse = basis.clone().try_inverse().unwrap();
        let (a, b) = crate::testing::held(&(&basis * a * &inverse), &(&basis * b), 1.0 / RATE);
        let mut model = Model::new(RATE, a, b, c * inverse, DMatrix::zeros(p, m)).unwrap();
        model.output_kinds = vec![Some(OutputKind::Position); p];
        model
    }

    /// Returns the largest relative difference of the responses of a plant and of the model that it decomposes.
    fn far(plant: &Plant, model: &Model) -> f64 {
        let hz = [3.0, 11.0, 12.05, 20.0, 31.0, 90.0];
        let whole = frequency_response(model, &hz).unwrap();
        let of = |(hz, whole): (&f64, &DMatrix<C>)| (plant.response(*hz) - whole).norm() / whole.norm();
        hz.iter().zip(&whole).map(of).fold(0.0, f64::max)
    }

    /// Two equal oscillators are two modes with real shapes, and a force at an input moves the masses there.
    #[test]
    fn two_equal_modes_are_two_modes() {
        let beta = dmatrix![1.0, 0.4; -0.3, 0.8; 0.5, -0.6];
        let model = oscillators(&beta, &beta.transpose(), 0.0);
        let plant = Plant::new(&model).unwrap();
        assert_eq!(plant.modes.len(), 3);
        assert!(far(&plant, &model) < 1e-8, "{}", far(&plant, &model));
        for mode in &plant.modes {
            // With a real beta and gamma, c b = gamma beta / (2 j w).
            let residues: Vec<C> = mode.c.iter().flat_map(|c| mode.b.iter().map(move |b| c * b)).collect();
            let size = residues.iter().map(|residue| residue.norm()).fold(0.0, f64::max);
            assert!(residues.iter().all(|residue| residue.re.abs() < 1e-6 * size), "{residues:?}");
        }
        for (i, column) in beta.column_iter().enumerate() {
            let (found, right) = (plant.mobility(i), column.norm_squared());
            assert!((found / right - 1.0).abs() < 1e-3, "{found} for {right}");
        }
        // Written and read again, they are the same two modes.
        let written = plant.to_model(&model);
        let read = Plant::in_modal_coordinates(&written, 3, &Default::default()).unwrap();
        assert_eq!(read.modes.len(), 3);
        assert!(far(&read, &model) < 1e-8, "{}", far(&read, &model));
    }

    /// Of two equal oscillators, one input and one output show only one. Of two whose first one is driven, two outputs
    /// show both, but the second one stands still. What is left is no mode, and no filter either.
    #[test]
    fn what_no_input_drives_is_no_mode() {
        let one = dmatrix![1.0; -0.3; 0.5];
        let first = (dmatrix![1.0; 0.0; 0.5], dmatrix![1.0, 0.0, 0.5; 0.0, 1.0, 0.0]);
        for (beta, gamma) in [(one.clone(), one.transpose()), first] {
            let model = oscillators(&beta, &gamma, 0.0);
            let plant = Plant::new(&model).unwrap();
            assert_eq!((plant.modes.len(), plant.chain.known()), (2, false));
            assert!(far(&plant, &model) < 1e-8, "{}", far(&plant, &model));
        }
    }

    /// If one of two equal oscillators drives the other one, however weakly, their pole has a chain of states, which
    /// no two modes represent. It stays in the rest.
    #[test]
    fn a_chain_of_equal_oscillators_is_no_pair_of_modes() {
        let beta = dmatrix![1.0, 0.4; -0.3, 0.8; 0.5, -0.6];
        for chain in [1.0, 1e-3, 1e-6] {
            let model = oscillators(&beta, &beta.transpose(), chain);
            let plant = Plant::new(&model).unwrap();
            assert_eq!(plant.modes.len(), 1, "{chain}");
            assert!(far(&plant, &model) < 1e-8, "{chain}: {}", far(&plant, &model));
        }
    }
}
