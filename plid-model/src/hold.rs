//! Continuous-time models over a step with held inputs.

use nalgebra::DMatrix;

/// Largest column sum of magnitudes at which an exponential is computed. Beyond it, no digit would be right, and
/// powers of the matrix overflow, so that nalgebra's scaling and squaring does not terminate.
const LARGEST: f64 = 1e15;

/// Returns the exponential of a square matrix, or a matrix of NaN if the matrix is not finite or extremely large.
#[must_use]
pub fn exponential(matrix: &DMatrix<f64>) -> DMatrix<f64> {
    let sum =
        matrix.column_iter().map(|column| column.lp_norm(1)).fold(0.0, |most, sum| if sum < most { most } else { sum });
    if sum < LARGEST { matrix.exp() } else { matrix.map(|_| f64::NAN) }
}

/// Returns the discrete-time A (n x n) and B (n x m) of dx/dt = A x + B u over a step (in s) with held inputs, from
/// the exponential of [A B; 0 0] (Van Loan, IEEE Trans. Automatic Control 23, 1978).
///
/// ```
/// let (a, b) = plid_model::held(&nalgebra::dmatrix![-2.0], &nalgebra::dmatrix![3.0], 0.1);
/// assert!((a[(0, 0)] - (-0.2_f64).exp()).abs() < 1e-15);
/// assert!((b[(0, 0)] - 1.5 * (1.0 - (-0.2_f64).exp())).abs() < 1e-15);
/// ```
#[must_use]
pub fn held(a: &DMatrix<f64>, b: &DMatrix<f64>, step: f64) -> (DMatrix<f64>, DMatrix<f64>) {
    let (n, m) = b.shape();
    let mut whole = DMatrix::zeros(n + m, n + m);
    whole.view_mut((0, 0), (n, n)).copy_from(&(a * step));
    whole.view_mut((0, n), (n, m)).copy_from(&(b * step));
    let whole = exponential(&whole);
    (whole.view((0, 0), (n, n)).into_owned(), whole.view((0, n), (n, m)).into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::dmatrix;

    #[test]
    fn the_exponential_of_an_extreme_matrix_is_no_number() {
        for size in [1e16, 1e70, 1e300, f64::INFINITY, f64::NAN] {
            let found = exponential(&dmatrix![0.0, 1.0; size, -1.0]);
            assert!(found.iter().all(|x| x.is_nan()), "{size}: {found}");
        }
        let found = exponential(&dmatrix![0.0, 1.0; -1.0, 0.0]);
        let turned = dmatrix![1.0_f64.cos(), 1.0_f64.sin(); -1.0_f64.sin(), 1.0_f64.cos()];
        assert!((found - turned).norm() < 1e-14);
    }
}
