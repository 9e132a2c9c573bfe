//! Intervals that are robust to errors of the noise model.
//!
//! The noise model is fitted to seconds of quiet records, and a few values determine its density at a narrow resonance,
//! where much of the evidence for an effect lies. The covariance is therefore also taken from the residuals themselves,
//! row by row (White, *Econometrica* 48, 1980), each divided by one minus its leverage (MacKinnon and White, *J.
//! Econometrics* 29, 1985, HC2).

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef, Par};
use nalgebra::DMatrix;

use crate::fit::single::Single;

/// Returns a factor, at least one, on the standard deviation of each parameter in `own`: the standard deviation from
/// the residuals over that from the noise model.
///
/// `linear` and `own` contain the derivatives of the whitened residual. `prior` is the precision of the first
/// parameters; those without a prior follow. `covariance` is that of all parameters under the noise model. No
/// leverage counts for more than `most_leverage`.
pub(super) fn widened(
    linear: &Single,
    own: MatRef<'_, f64>,
    prior: &[f64],
    residual: &[f64],
    covariance: &DMatrix<f64>,
    most_leverage: f64,
) -> Vec<f64> {
    let (n, count) = (covariance.nrows(), own.ncols());
    let covariance = MatRef::from_column_major_slice(covariance.as_slice(), n, n);
    let mut power = vec![0.0; count];
    linear.for_each_chunk(own, |from, rows| {
        // The change of each parameter by the residual of each row, and the leverages of the rows.
        let mut moved = Mat::zeros(rows.nrows(), n);
        matmul(moved.as_mut(), Accum::Replace, rows, covariance, 1.0, Par::Seq);
        for i in 0..rows.nrows() {
            let leverage: f64 = (0..n).map(|j| moved[(i, j)] * rows[(i, j)]).sum();
            let square = residual[from + i].powi(2) / (1.0 - leverage.clamp(0.0, most_leverage));
            (0..count).for_each(|k| power[k] += square * moved[(i, n - count + k)].powi(2));
        }
    });
    let factor = |k: usize| {
        let own = n - count + k;
        // The covariance of the prior is known.
        let of_prior: f64 = prior.iter().enumerate().map(|(j, prior)| covariance[(own, j)].powi(2) * prior).sum();
        ((power[k] + of_prior) / covariance[(own, own)].max(f64::MIN_POSITIVE)).sqrt().max(1.0)
    };
    (0..count).map(factor).collect()
}

#[cfg(test)]
mod tests {
    use nalgebra::DVector;

    use super::*;
    use crate::testing::random_input;

    const ROWS: usize = 4000;

    /// Computes the factors for parameters that all have a prior.
    fn factors(jacobian: &[f64], prior: &[f64], residual: &[f64]) -> Vec<f64> {
        let j = DMatrix::from_column_slice(ROWS, prior.len(), jacobian);
        let precision = DMatrix::from_diagonal(&DVector::from_column_slice(prior));
        let covariance = (j.transpose() * &j + precision).try_inverse().unwrap();
        let linear = Single::filled(ROWS, prior.len() - 1, |k, column| {
            column.iter_mut().zip(&jacobian[k * ROWS..]).for_each(|(to, x)| *to = *x as f32);
        });
        let own = MatRef::from_column_major_slice(&jacobian[(prior.len() - 1) * ROWS..], ROWS, 1);
        widened(&linear, own, prior, residual, &covariance, 0.9)
    }

    /// Returns the factor of the second of two parameters. Only a tenth of the rows determine it, and there the noise
    /// is `louder` times as large as elsewhere.
    fn factor(louder: f64) -> f64 {
        let noise = random_input(1, ROWS, 1).remove(0);
        let told = |row: usize| row.is_multiple_of(10);
        let residual: Vec<f64> = (0..ROWS).map(|row| noise[row] * if told(row) { louder } else { 1.0 }).collect();
        let first = random_input(2, ROWS, 1).remove(0);
        let second =
            random_input(3, ROWS, 1).remove(0).into_iter().enumerate().map(|(row, x)| if told(row) { x } else { 0.0 });
        let jacobian: Vec<f64> = first.into_iter().chain(second).collect();
        factors(&jacobian, &[0.0, 0.0], &residual)[0]
    }

    #[test]
    fn intervals_grow_as_the_noise_where_they_come_from() {
        // Four hundred rows determine a standard deviation to within about a twentieth.
        assert!((factor(2.0) / 2.0 - 1.0).abs() < 0.1, "{}", factor(2.0));
        assert!(factor(1.0) < 1.1 && factor(0.5) == 1.0, "{} {}", factor(1.0), factor(0.5));
    }

    /// If a prior determines a parameter, the residuals contribute nothing.
    #[test]
    fn a_prior_keeps_its_word() {
        let residual = random_input(4, ROWS, 1).remove(0).iter().map(|x| 9.0 * x).collect::<Vec<f64>>();
        let jacobian = random_input(5, ROWS, 1).remove(0);
        let strong = factors(&jacobian, &[1e9], &residual)[0];
        let none = factors(&jacobian, &[0.0], &residual)[0];
        assert!(strong < 1.01 && (none / 9.0 - 1.0).abs() < 0.1, "{strong} {none}");
    }
}
