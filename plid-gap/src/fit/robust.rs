//! Intervals where the noise is not quite what its model says.
//!
//! The noise model is fitted to seconds of quiet records, and knows its density at a narrow resonance from a few values; what tells of an effect often lies just
//! there. So the covariance is also taken from the residuals themselves, row by row (White, Econometrica 48, 1980), each over one minus its leverage (MacKinnon
//! and White, J. Econometrics 29, 1985, HC2).

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef, Par};
use nalgebra::DMatrix;

/// Rows whose leverages are found together.
const CHUNK: usize = 1024;

/// A row that decides a parameter alone says nothing of its own noise.
const MOST_LEVERAGE: f64 = 0.9;

/// Factors on the standard deviations of the last `count` parameters, from one up: residuals' over the model's. `jacobian` is rows x n, column after column, of
/// whitened residuals; `prior` has one over the prior's variance of each parameter. None where the normal matrix has no inverse.
pub fn widened(jacobian: &[f64], prior: &[f64], residual: &[f64], count: usize) -> Option<Vec<f64>> {
    let (rows, n) = (residual.len(), prior.len());
    let all = MatRef::from_column_major_slice(jacobian, rows, n);
    let mut normal = Mat::zeros(n, n);
    matmul(&mut normal, Accum::Replace, all.transpose(), all, 1.0, Par::Seq);
    let mut normal = DMatrix::from_fn(n, n, |i, j| normal[(i, j)]);
    (0..n).for_each(|i| normal[(i, i)] += prior[i]);
    let inverse = normal.cholesky()?.inverse();
    let inverse_mat = Mat::from_fn(n, n, |i, j| inverse[(i, j)]);
    let mut power = vec![0.0; count];
    let mut moved = Mat::zeros(CHUNK, n);
    for from in (0..rows).step_by(CHUNK) {
        let height = CHUNK.min(rows - from);
        let chunk = all.subrows(from, height);
        // What a row's residual moves each parameter by.
        matmul(moved.subrows_mut(0, height), Accum::Replace, chunk, &inverse_mat, 1.0, Par::Seq);
        for i in 0..height {
            let leverage: f64 = (0..n).map(|j| moved[(i, j)] * chunk[(i, j)]).sum();
            let square = residual[from + i].powi(2) / (1.0 - leverage.clamp(0.0, MOST_LEVERAGE));
            (0..count).for_each(|k| power[k] += square * moved[(i, n - count + k)].powi(2));
        }
    }
    let factor = |k: usize| {
        let own = n - count + k;
        // What the prior says is taken at its word.
        let of_prior: f64 = (0..n).map(|j| inverse[(own, j)].powi(2) * prior[j]).sum();
        ((power[k] + of_prior) / inverse[(own, own)].max(f64::MIN_POSITIVE)).sqrt().max(1.0)
    };
    Some((0..count).map(factor).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::random_input;

    const ROWS: usize = 4000;

    /// Two parameters; the second is told by a tenth of the rows alone, where the noise is `louder` than elsewhere.
    fn factor(louder: f64) -> f64 {
        let noise = random_input(1, ROWS, 1).remove(0);
        let told = |row: usize| row.is_multiple_of(10);
        let residual: Vec<f64> = (0..ROWS).map(|row| noise[row] * if told(row) { louder } else { 1.0 }).collect();
        let first = random_input(2, ROWS, 1).remove(0);
        let second =
            random_input(3, ROWS, 1).remove(0).into_iter().enumerate().map(|(row, x)| if told(row) { x } else { 0.0 });
        let jacobian: Vec<f64> = first.into_iter().chain(second).collect();
        widened(&jacobian, &[0.0, 0.0], &residual, 1).unwrap()[0]
    }

    #[test]
    fn intervals_grow_as_the_noise_where_they_come_from() {
        // Four hundred rows tell a standard deviation to a twentieth or so.
        assert!((factor(2.0) / 2.0 - 1.0).abs() < 0.1, "{}", factor(2.0));
        assert!(factor(1.0) < 1.1 && factor(0.5) == 1.0, "{} {}", factor(1.0), factor(0.5));
    }

    /// A prior that says all leaves nothing to the residuals.
    #[test]
    fn a_prior_keeps_its_word() {
        let residual = random_input(4, ROWS, 1).remove(0).iter().map(|x| 9.0 * x).collect::<Vec<f64>>();
        let jacobian = random_input(5, ROWS, 1).remove(0);
        let strong = widened(&jacobian, &[1e9], &residual, 1).unwrap()[0];
        let none = widened(&jacobian, &[0.0], &residual, 1).unwrap()[0];
        assert!(strong < 1.01 && (none / 9.0 - 1.0).abs() < 0.1, "{strong} {none}");
        assert_eq!(widened(&vec![0.0; ROWS], &[0.0], &residual, 1), None);
    }
}
