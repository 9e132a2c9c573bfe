//! The discrete covariance of a continuous white force.

use nalgebra::{DMatrix, SymmetricEigen};

/// Returns the covariance that white noise of intensity W (n x n) adds over `step_s`: int_0^h exp(A s) W exp(A s)^T
/// ds, by the method of Van Loan (1978).
///
/// The exponential of this method contains exp(-A h), which loses digits if A h is large. It is therefore computed
/// over a short step, which is then doubled repeatedly: Q(2h) = Q(h) + exp(A h) Q(h) exp(A h)^T.
pub(crate) fn sampled(a: &DMatrix<f64>, intensity: &DMatrix<f64>, step_s: f64) -> DMatrix<f64> {
    let n = a.nrows();
    let size = a.column_iter().map(|c| c.lp_norm(1)).fold(0.0, f64::max) * step_s;
    let doublings = size.max(1.0).log2().ceil() as i32;
    let h = step_s / 2.0_f64.powi(doublings);
    let mut block = DMatrix::zeros(2 * n, 2 * n);
    block.view_mut((0, 0), (n, n)).copy_from(&(-a * h));
    block.view_mut((0, n), (n, n)).copy_from(&(intensity * h));
    block.view_mut((n, n), (n, n)).copy_from(&(a.transpose() * h));
    let block = block.exp();
    let mut transition = block.view((n, n), (n, n)).transpose();
    let mut covariance = &transition * block.view((0, n), (n, n));
    for _ in 0..doublings {
        covariance = symmetric(&covariance + &transition * &covariance * transition.transpose());
        transition = &transition * &transition;
    }
    symmetric(covariance)
}

/// Solves P = A P A^T + Q for a stable A by doubling (Smith 1968): P_{i+1} = P_i + A_i P_i A_i^T, A_{i+1} = A_i^2.
pub(crate) fn stationary(a: &DMatrix<f64>, q: &DMatrix<f64>) -> DMatrix<f64> {
    let (mut transition, mut p) = (a.clone(), q.clone());
    // No mode lasts 2^64 samples; the loop ends when the transition has decayed.
    for _ in 0..64 {
        let added = &transition * &p * transition.transpose();
        if added.amax() <= 1e-18 * p.amax() {
            break;
        }
        p = symmetric(&p + added);
        transition = &transition * &transition;
    }
    p
}

/// Returns the symmetric square root of a positive semidefinite matrix. Eigenvalues that rounding has made negative
/// count as zero.
pub(crate) fn square_root(covariance: &DMatrix<f64>) -> DMatrix<f64> {
    let SymmetricEigen { eigenvectors: v, eigenvalues } = SymmetricEigen::new(covariance.clone());
    let roots = eigenvalues.map(|l| l.max(0.0).sqrt());
    &v * DMatrix::from_diagonal(&roots) * v.transpose()
}

fn symmetric(m: DMatrix<f64>) -> DMatrix<f64> {
    (&m + m.transpose()) * 0.5
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An oscillator under a white force of intensity w has E q^2 = w / (4 zeta omega^3) and E v^2 = w / (4 zeta
    /// omega).
    #[test]
    fn stationary_oscillator_is_the_closed_form_at_any_step() {
        let (omega, zeta, w): (f64, f64, f64) = (1055.0, 0.005, 3.0);
        let a = DMatrix::from_row_slice(2, 2, &[0.0, 1.0, -omega * omega, -2.0 * zeta * omega]);
        let intensity = DMatrix::from_row_slice(2, 2, &[0.0, 0.0, 0.0, w]);
        for step in [1e-5, 1.0 / 1600.0, 0.02] {
            let q = sampled(&a, &intensity, step);
            let p = stationary(&(&a * step).exp(), &q);
            let (pq, pv) = (w / (4.0 * zeta * omega.powi(3)), w / (4.0 * zeta * omega));
            assert!((p[(0, 0)] / pq - 1.0).abs() < 1e-8, "{step}: {}", p[(0, 0)] / pq);
            assert!((p[(1, 1)] / pv - 1.0).abs() < 1e-8, "{step}: {}", p[(1, 1)] / pv);
            assert!(p[(0, 1)].abs() < 1e-8 * (pq * pv).sqrt());
        }
    }

    #[test]
    fn sampled_first_order_is_the_closed_form() {
        let one = |v: f64| DMatrix::from_element(1, 1, v);
        for step in [1e-3, 0.3, 40.0] {
            let q = sampled(&one(-2.0), &one(5.0), step)[0];
            let expected = 5.0 / 4.0 * (1.0 - (-4.0 * step).exp());
            assert!((q / expected - 1.0).abs() < 1e-12, "{step}");
        }
    }

    #[test]
    fn square_root_squares_to_the_matrix_even_if_singular() {
        let g = DMatrix::from_row_slice(3, 1, &[1.0, -2.0, 0.5]);
        let p = &g * g.transpose();
        let s = square_root(&p);
        assert!((&s * &s - &p).amax() < 1e-12 * p.amax());
    }
}
