//! What can be asked of any conditional expectation.

use plid_backends::Plain;
use plid_core::ConditionalExpectations;
use plid_model::scalar_bayes::ScalarPrior;
use plid_variants::covariance::BiermanUd;

use crate::run::Variant;
use crate::scalar_case::ScalarCase;
use crate::{allocations, properties};

/// How an expectation does beside exact Bayes on the scalar plant x+ = a x + b u + xi, z = x + w.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    /// Root mean square error of a.
    pub rmse: f64,
    /// The same of the exact posterior mean, which is the least that there is.
    pub exact_rmse: f64,
    /// Mean of the squared error of a over its variance in P: 1 if P tells the accuracy as it is.
    pub nees: f64,
}

const GRID_POINTS: usize = 120;

/// Runs `E` on `runs` random plants and records with state noise of variance `sigma` and sensor noise of variance `r`.
pub fn grid_bayes<E: ConditionalExpectations<Scalar = f64>>(sigma: f64, r: f64, runs: usize) -> Calibration {
    let (mut own, mut exact, mut nees) = (0.0, 0.0, 0.0);
    for seed in 0..runs as u64 {
        let case = ScalarCase::draw(sigma, r, 1000 + seed);
        exact += (case.exact_mean(GRID_POINTS) - case.a).powi(2);
        let (found, variance) = case.filtered::<E>();
        own += (found - case.a).powi(2);
        nees += (found - case.a).powi(2) / variance;
    }
    let runs = runs as f64;
    Calibration { rmse: (own / runs).sqrt(), exact_rmse: (exact / runs).sqrt(), nees: nees / runs }
}

/// Holds a conditional expectation to what any must satisfy. A step allocates nothing. P stays a covariance, forms
/// agree, and checkpoints continue to the same bits. Permuted and rescaled channels permute and rescale the estimate.
/// On a scalar plant its error is no smaller than that of exact Bayes, and smaller than the prior's.
///
/// How good it is beyond that is not judged; [`grid_bayes`] tells.
///
/// # Panics
/// Where it does not conform.
pub fn check_expectation<E: ConditionalExpectations<Scalar = f64>>() {
    allocations::a_step_allocates_nothing(&Variant::of::<BiermanUd<Plain<f64>>, E>());
    properties::check_expectation::<E>();
    let (found, prior) = (grid_bayes::<E>(0.1, 0.5, 100), ScalarPrior::default());
    // The truth is drawn at random: over 100 runs an approximation may be lucky by a per cent.
    assert!(found.rmse > 0.97 * found.exact_rmse, "better than exact Bayes, which cannot be: {found:?}");
    assert!(found.rmse < 0.7 * prior.a.1.sqrt(), "the estimate hardly learns from the record: {found:?}");
    assert!(found.nees.is_finite() && found.nees > 0.0, "{found:?}");
}
