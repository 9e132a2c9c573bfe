use nalgebra::{Complex, DMatrix, DVector};

use super::error::ModelError;
use super::state_space::LARGEST;

/// Eigenvalues with right and left eigenvectors, normalised so that l_k . r_k = 1.
pub(super) struct Eigen {
    pub values: Vec<Complex<f64>>,
    /// The right eigenvectors as columns.
    pub right: DMatrix<Complex<f64>>,
    /// The left eigenvectors as rows: the inverse of `right`. `None` if the eigenvectors are linearly dependent.
    pub left: Option<DMatrix<Complex<f64>>>,
}

/// Balances A, unless its entries are too large: returns D^{-1} A D, whose rows and columns have similar norms, and the
/// diagonal of D. Canonical forms are badly balanced.
pub(super) fn balance(a: &DMatrix<f64>) -> (DMatrix<f64>, DVector<f64>) {
    let mut balanced = a.clone();
    if a.amax() > LARGEST {
        return (balanced, DVector::from_element(a.nrows(), 1.0));
    }
    let scale = nalgebra::linalg::balancing::balance_parlett_reinsch(&mut balanced);
    (balanced, scale)
}

/// Returns the eigenvalues of A (n x n) in the order in which the library computes them.
///
/// # Errors
/// [`ModelError::Eigenvalues`] if the iteration does not converge.
pub fn eigenvalues(a: &DMatrix<f64>) -> Result<Vec<Complex<f64>>, ModelError> {
    let (balanced, _) = balance(a);
    library(&balanced).eigenvalues().map_err(|_| ModelError::Eigenvalues)
}

/// Returns the eigenvalues and eigenvectors of A.
pub(super) fn eigen(a: &DMatrix<f64>) -> Result<Eigen, ModelError> {
    let n = a.nrows();
    let (balanced, scale) = balance(a);
    let found = library(&balanced).eigen().map_err(|_| ModelError::Eigenvalues)?;
    let values = found.S().column_vector().iter().copied().collect();
    let vectors = DMatrix::from_fn(n, n, |i, j| found.U()[(i, j)]);
    let left = vectors.clone().try_inverse().filter(|left| left.iter().all(|x| x.is_finite()));
    let left = left.map(|l| DMatrix::from_fn(n, n, |i, j| l[(i, j)] / scale[j]));
    let right = DMatrix::from_fn(n, n, |i, j| vectors[(i, j)] * scale[i]);
    Ok(Eigen { values, right, left })
}

/// Converts a matrix for faer, the library that computes the eigenvalues. nalgebra's Schur decomposition does not
/// converge for a cyclic permutation, such as a delay line in a loop. At a tolerance of machine epsilon, it also
/// fails for structures of 29 states that the testbed draws.
fn library(a: &DMatrix<f64>) -> faer::Mat<f64> {
    faer::Mat::from_fn(a.nrows(), a.ncols(), |i, j| a[(i, j)])
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Returns the larger of |A r - lambda r| and |l A - lambda l|, relative to A and the vectors.
    fn misfit(a: &DMatrix<f64>) -> f64 {
        let found = eigen(a).unwrap();
        let complex = a.map(Complex::from);
        let size = a.norm().max(1e-300);
        let of = |k: usize| {
            let (value, r) = (found.values[k], found.right.column(k));
            let right = (&complex * r - r * value).norm() / (size * r.norm());
            let left = found.left.as_ref().map_or(0.0, |left| {
                let l = left.row(k);
                (l * &complex - l * value).norm() / (size * l.norm())
            });
            right.max(left)
        };
        (0..a.nrows()).map(of).fold(0.0, f64::max)
    }

    #[test]
    fn a_cyclic_permutation_has_the_roots_of_one() {
        for n in [2, 3, 4, 7, 16, 45] {
            let a = DMatrix::from_fn(n, n, |i, j| f64::from(i == (j + 1) % n));
            assert!(misfit(&a) < 1e-13, "{n}: {}", misfit(&a));
            for value in eigenvalues(&a).unwrap() {
                assert!((value.powu(n as u32) - Complex::ONE).norm() < 1e-12 * n as f64, "{n}: {value}");
            }
        }
    }

    /// Tests a delay line, a repeated pole, a zero matrix and an empty matrix. Linearly dependent vectors have no
    /// inverse, or one whose size is determined by rounding.
    #[test]
    fn defective_matrices_have_their_values() {
        for (value, n) in [(0.0, 1), (0.0, 3), (0.0, 40), (0.9, 6), (1.0, 2)] {
            let a = DMatrix::from_fn(n, n, |i, j| if i == j { value } else { f64::from(j == i + 1) });
            let found = eigen(&a).unwrap();
            assert!(found.values.iter().all(|v| (v - value).norm() < 1e-2), "{:?}", found.values);
            assert!(n == 1 || found.left.is_none_or(|left| left.norm() > 1e8));
        }
        assert!(eigen(&DMatrix::zeros(5, 5)).unwrap().values.iter().all(|v| *v == Complex::ZERO));
        assert!(eigenvalues(&DMatrix::zeros(0, 0)).unwrap().is_empty());
    }

    proptest! {
        /// The vectors satisfy their definition, and complex values come in exact conjugate pairs, so that the values
        /// above the real axis contain one of each pair.
        #[test]
        fn vectors_satisfy_their_definition(n in 1_usize..32, entries in prop::collection::vec(-1.0..1.0, 1024)) {
            let a = DMatrix::from_fn(n, n, |i, j| entries[i * 32 + j]);
            prop_assert!(misfit(&a) < 1e-11, "{}", misfit(&a));
            let values = eigenvalues(&a).unwrap();
            prop_assert_eq!(values.iter().filter(|v| v.im > 0.0).count(), values.iter().filter(|v| v.im < 0.0).count());
        }
    }
}
