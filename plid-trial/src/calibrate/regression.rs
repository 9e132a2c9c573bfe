//! Logistic regression with a prior whose mean leaves probabilities as they are stated.

use nalgebra::{DMatrix, DVector};
use plid_gap::calibration::{Coefficients, log_odds};

use super::outcomes::Outcome;

/// Standard deviations of the prior of the constant, of the factor of the log-odds before calibration, and of the
/// factors of the basis, whose quantities lie between zero and one.
pub(super) const PRIOR: [f64; 3] = [1.0, 0.5, 3.0];

/// Largest number of steps of Newton's method. The posterior has one maximum.
const STEPS: usize = 100;

/// Change of the log-odds at which the iteration ends.
const CLOSE: f64 = 1e-9;

/// Returns the coefficients of maximum posterior density, given statements and the quantities that count.
pub(crate) fn fit(outcomes: &[&Outcome], basis: &[&str]) -> Coefficients {
    let value = |outcome: &Outcome, name: &str| outcome.statement.basis.get(name).copied().unwrap_or(0.0);
    let columns = 2 + basis.len();
    let x = DMatrix::from_fn(outcomes.len(), columns, |row, column| match column {
        0 => 1.0,
        1 => log_odds(outcomes[row].statement.before),
        _ => value(outcomes[row], basis[column - 2]),
    });
    let right = DVector::from_fn(outcomes.len(), |row, _| f64::from(u8::from(outcomes[row].right)));
    let mean = DVector::from_fn(columns, |column, _| if column == 1 { 1.0 } else { 0.0 });
    let precision = DVector::from_fn(columns, |column, _| PRIOR[column.min(2)].powi(-2));
    let found = newton(&x, &right, &mean, &precision);
    let basis = basis.iter().zip(found.iter().skip(2)).map(|(name, &factor)| ((*name).to_owned(), factor));
    Coefficients { constant: found[0], before: found[1], basis: basis.collect() }
}

/// Returns the maximum of the log posterior by Newton's method, with each step halved until the density increases.
pub(super) fn newton(
    x: &DMatrix<f64>,
    right: &DVector<f64>,
    mean: &DVector<f64>,
    precision: &DVector<f64>,
) -> DVector<f64> {
    let density = |b: &DVector<f64>| {
        let likelihood: f64 = (x * b).iter().zip(right).map(|(z, y)| y * z - softplus(*z)).sum();
        let off = b - mean;
        likelihood - 0.5 * off.component_mul(&off).dot(precision)
    };
    let mut b = mean.clone();
    for _ in 0..STEPS {
        let p = (x * &b).map(|z| 1.0 / (1.0 + (-z).exp()));
        let gradient = x.transpose() * (right - &p) - (&b - mean).component_mul(precision);
        let weighted = DMatrix::from_fn(x.nrows(), x.ncols(), |i, j| p[i] * (1.0 - p[i]) * x[(i, j)]);
        let curvature = x.transpose() * weighted + DMatrix::from_diagonal(precision);
        let Some(step) = curvature.cholesky().map(|factor| factor.solve(&gradient)) else { break };
        let before = density(&b);
        let mut length = 1.0;
        while density(&(&b + &step * length)) < before && length > 1e-6 {
            length *= 0.5;
        }
        b += &step * length;
        if x.nrows() == 0 || (x * step).amax() < CLOSE {
            break;
        }
    }
    b
}

/// Returns ln(1 + exp(z)) without overflow.
fn softplus(z: f64) -> f64 {
    z.max(0.0) + (-z.abs()).exp().ln_1p()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use plid_gap::answer::schema::{About, Statement};
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    fn outcome(before: f64, left: f64, right: bool) -> Outcome {
        let basis = BTreeMap::from([("left".to_owned(), left)]);
        Outcome { case: String::new(), statement: Statement { about: About::Effect, before, basis }, right }
    }

    #[test]
    fn without_outcomes_nothing_changes() {
        let basis = BTreeMap::from([("left".to_owned(), 0.0)]);
        assert_eq!(fit(&[], &["left"]), Coefficients { basis, ..Coefficients::default() });
    }

    /// With many outcomes, the coefficients are found with which the outcomes were drawn.
    #[test]
    fn the_coefficients_of_the_truth_are_found() {
        let truth = Coefficients { constant: -0.5, before: 0.6, basis: BTreeMap::from([("left".to_owned(), -2.0)]) };
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let drawn: Vec<Outcome> = (0..40_000)
            .map(|_| {
                let (before, left) = (rng.random_range(0.05..0.99), rng.random_range(0.0..1.0));
                let wrong = outcome(before, left, false);
                let right = rng.random_range(0.0..1.0) < truth.probability(&wrong.statement);
                Outcome { right, ..wrong }
            })
            .collect();
        let found = fit(&drawn.iter().collect::<Vec<_>>(), &["left"]);
        assert!((found.constant - truth.constant).abs() < 0.06, "{found:?}");
        assert!((found.before - truth.before).abs() < 0.03, "{found:?}");
        assert!((found.basis["left"] - truth.basis["left"]).abs() < 0.1, "{found:?}");
    }

    /// With one statement of 0.5 that was right, the density has its maximum where its gradient with respect to the
    /// constant c vanishes: 1 - p(c) = c / PRIOR^2. The log-odds of the statement are zero, so their factor keeps its
    /// prior mean.
    #[test]
    fn one_outcome_moves_the_constant_as_far_as_the_prior_allows() {
        let found = fit(&[&outcome(0.5, 0.0, true)], &[]);
        let gradient = 1.0 - 1.0 / (1.0 + (-found.constant).exp()) - found.constant * PRIOR[0].powi(-2);
        assert!(gradient.abs() < 1e-9 && (found.before - 1.0).abs() < 1e-9, "{found:?}");
    }
}
