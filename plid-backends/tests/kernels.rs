//! The kernels of every backend against their definitions, entry by entry.

use plid_backends::{Faer, Nalgebra, Plain};
use plid_core::kernels::{Support, Tails};
use plid_core::{Backend, Dense, Matrix, Scalar};

/// Numbers without a pattern, so that a wrong index changes the result.
fn entries<S: Scalar>(rows: usize, columns: usize, seed: usize) -> Dense<S> {
    Dense::from_fn(rows, columns, |i, j| S::from_f64(((seed + 7 * i + 31 * j).pow(2) as f64 * 0.129898).sin()))
}

fn store<B: Backend>(from: &Dense<B::Scalar>) -> B::Matrix {
    let mut matrix = B::Matrix::zeros(from.rows(), from.columns());
    for j in 0..from.columns() {
        matrix.view_mut().column_mut(j).copy_from_slice(from.column(j));
    }
    matrix
}

fn assert_close<S: Scalar>(found: S, expected: f64, place: &str) {
    let error = (found.to_f64() - expected).abs();
    assert!(error <= 200.0 * S::EPSILON.max(1e-16) * (1.0 + expected.abs()), "{place}: {found:?}, not {expected}");
}

/// C + alpha A B^T; both below and above the size at which a library takes over, and in a block of a larger matrix.
fn symmetric_product<B: Backend>() {
    for (size, k) in [(1, 1), (5, 3), (17, 12), (23, 2), (40, 33)] {
        let a = entries::<B::Scalar>(size, k, 1);
        let weights: Vec<f64> = (0..k).map(|j| 0.5 + (j as f64).cos()).collect();
        // B = A diag(weights): the product is symmetric.
        let b = Dense::from_fn(size, k, |i, j| a.at(i, j) * B::Scalar::from_f64(weights[j]));
        let c = entries::<B::Scalar>(size + 2, size + 3, 5);
        let mut result = store::<B>(&c);
        let alpha = B::Scalar::from_f64(-1.5);
        let (a_stored, b_stored) = (store::<B>(&a), store::<B>(&b));
        let mut whole = result.view_mut();
        let block = whole.block_mut(2, 1, size, size);
        B::symmetric_product_lower(block, alpha, a_stored.view(), b_stored.view());
        for j in 0..size {
            for i in j..size {
                let sum: f64 = (0..k).map(|l| a.at(i, l).to_f64() * b.at(j, l).to_f64()).sum();
                let expected = c.at(i + 2, j + 1).to_f64() - 1.5 * sum;
                assert_close(result.view().at(i + 2, j + 1), expected, &format!("{size} x {k}, ({i}, {j})"));
            }
        }
        // Entries outside the block must not change.
        for j in 0..size + 3 {
            for i in 0..size + 2 {
                if i < 2 || j < 1 || j > size {
                    assert_eq!(result.view().at(i, j), c.at(i, j), "({i}, {j})");
                }
            }
        }
    }
}

/// Y + M (phi (x) I)^T from the lower triangle of M alone.
fn block_product<B: Backend>() {
    for (n, k) in [(1, 1), (3, 2), (4, 5), (9, 1), (12, 6), (29, 3), (34, 4)] {
        let size = n * k;
        let symmetric = entries::<B::Scalar>(size, size, 2);
        let at = |i: usize, j: usize| symmetric.at(i.max(j), i.min(j)).to_f64();
        let lower =
            Dense::from_fn(size, size, |i, j| if i >= j { symmetric.at(i, j) } else { B::Scalar::from_f64(0.0) });
        let phi: Vec<f64> = (0..k).map(|t| (1.0 + t as f64).sin()).collect();
        let phi_s: Vec<_> = phi.iter().map(|&x| B::Scalar::from_f64(x)).collect();
        let y = entries::<B::Scalar>(size, n, 9);
        let (m, mut result) = (store::<B>(&lower), store::<B>(&y));
        let mut work = Dense::from_fn(n, size, |_, _| B::Scalar::from_f64(f64::NAN));
        B::block_product_lower(m.view(), &phi_s, result.view_mut(), work.view_mut());
        for i in 0..size {
            for c in 0..n {
                let sum: f64 = (0..k).map(|t| at(i, t * n + c) * phi_s[t].to_f64()).sum();
                assert_close(result.view().at(i, c), y.at(i, c).to_f64() + sum, &format!("n {n}, k {k}, ({i}, {c})"));
            }
        }
    }
}

/// The arrays W (n x r) of the triangularisations: a general one, and some with rows that are zero or repeat.
fn arrays<S: Scalar>() -> Vec<Dense<S>> {
    let general = entries::<S>(5, 9, 3);
    let without =
        |zero: &[usize]| Dense::from_fn(5, 9, |i, j| if zero.contains(&i) { S::zero() } else { general.at(i, j) });
    let repeated = Dense::from_fn(5, 9, |i, j| general.at(i.min(3), j));
    vec![general.clone(), without(&[4]), without(&[2]), without(&[0, 3]), repeated, entries(4, 4, 8), entries(1, 2, 1)]
}

/// Appends rows of zeros to fill up a panel.
fn filled<S: Scalar>(w: &Dense<S>, rows: usize) -> Dense<S> {
    Dense::from_fn(rows, w.columns(), |i, j| if i < w.rows() { w.at(i, j) } else { S::zero() })
}

/// U unit upper triangular with U diag(d) U^T = W diag(weights) W^T, d not negative.
fn gram_schmidt<B: Backend>() {
    for (which, w) in arrays::<B::Scalar>().into_iter().enumerate() {
        let (n, r) = (w.rows(), w.columns());
        let rows = n.next_multiple_of(8);
        let weights: Vec<f64> = (0..r).map(|j| if j == 1 { 0.0 } else { 0.3 + j as f64 }).collect();
        let weights_s: Vec<_> = weights.iter().map(|&x| B::Scalar::from_f64(x)).collect();
        let (mut array, mut u) = (store::<B>(&filled(&w, rows)), store::<B>(&entries(rows, n, 4)));
        let nan = B::Scalar::from_f64(f64::NAN);
        let (mut d, mut work) = (vec![nan; n], vec![nan; 4 * r + rows]);
        let support = Support { starts: &vec![[0, n]; n], middle: n };
        B::weighted_gram_schmidt(array.view_mut(), support, &weights_s, u.view_mut(), &mut d, &mut work);
        let u = u.view();
        for i in 0..n {
            assert!(d[i] >= B::Scalar::from_f64(0.0), "array {which}: d_{i} = {:?}", d[i]);
            for j in 0..=i {
                assert_eq!(u.at(i, j).to_f64(), f64::from(u8::from(i == j)), "array {which}: U({i}, {j})");
            }
            for j in 0..n {
                let expected: f64 = (0..r).map(|k| w.at(i, k).to_f64() * weights[k] * w.at(j, k).to_f64()).sum();
                let found: f64 = (0..n).map(|k| u.at(i, k).to_f64() * d[k].to_f64() * u.at(j, k).to_f64()).sum();
                assert_close(B::Scalar::from_f64(found), expected, &format!("array {which}, ({i}, {j})"));
            }
        }
    }
}

/// S upper triangular with S S^T = W W^T, its diagonal not negative.
fn triangularised<B: Backend>() {
    for (which, w) in arrays::<B::Scalar>().into_iter().enumerate() {
        let (n, r) = (w.rows(), w.columns());
        let rows = n.next_multiple_of(8);
        let (mut array, mut s) = (store::<B>(&filled(&w, rows)), store::<B>(&entries(rows, n, 4)));
        let mut work = vec![B::Scalar::from_f64(f64::NAN); 2 * r + rows];
        let ends: Vec<usize> = (0..n).map(|i| r - n + i).collect();
        let tails = Tails { starts: &vec![0; n], ends: &ends };
        B::triangular_factor(array.view_mut(), n, tails, s.view_mut(), &mut work);
        let s = s.view();
        for i in 0..n {
            assert!(s.at(i, i) >= B::Scalar::from_f64(0.0), "array {which}: S({i}, {i}) = {:?}", s.at(i, i));
            for j in 0..i {
                assert_eq!(s.at(i, j).to_f64(), 0.0, "array {which}: S({i}, {j})");
            }
            for j in 0..n {
                let expected: f64 = (0..r).map(|k| w.at(i, k).to_f64() * w.at(j, k).to_f64()).sum();
                let found: f64 = (0..n).map(|k| s.at(i, k).to_f64() * s.at(j, k).to_f64()).sum();
                assert_close(B::Scalar::from_f64(found), expected, &format!("array {which}, ({i}, {j})"));
            }
        }
    }
}

macro_rules! test_every_backend {
    ($($name:ident = $backend:ty),* $(,)?) => {
        $(
            mod $name {
                use super::*;

                #[test]
                fn symmetric_product_is_its_sum() {
                    symmetric_product::<$backend>();
                }

                #[test]
                fn block_product_is_its_sum() {
                    block_product::<$backend>();
                }

                #[test]
                fn gram_schmidt_factors_the_array() {
                    gram_schmidt::<$backend>();
                }

                #[test]
                fn triangular_factor_squares_to_the_array() {
                    triangularised::<$backend>();
                }
            }
        )*
    };
}

test_every_backend!(
    plain_f64 = Plain<f64>,
    plain_f32 = Plain<f32>,
    plain_double_double = Plain<qd::Quad>,
    nalgebra_f64 = Nalgebra<f64>,
    nalgebra_f32 = Nalgebra<f32>,
    faer_f64 = Faer<f64>,
    faer_f32 = Faer<f32>,
);
