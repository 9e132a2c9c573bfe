//! Requirements on any conditional expectation.

use plid_backends::Plain;
use plid_core::ConditionalExpectations;
use plid_model::scalar_bayes::ScalarPrior;
use plid_variants::covariance::BiermanUd;

use crate::case::{Options, random_case};
use crate::run::{Variant, finish_with, outcome, relative};
use crate::scalar_case::ScalarCase;
use crate::{allocations, properties};

/// Accuracy of an expectation relative to exact Bayes, on the scalar plant x+ = a x + b u + xi, z = x + w.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    /// Root mean square error of a.
    pub rmse: f64,
    /// Root mean square error of the exact posterior mean of a, which is the least possible.
    pub exact_rmse: f64,
    /// Mean of the squared error of a over its variance in P: 1 if P states the true accuracy.
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

/// Checks that a conditional expectation has the properties that all must have. A step allocates nothing. P remains a
/// covariance, forms agree, and runs continued from checkpoints are bit-identical. Permuted and rescaled channels
/// permute and rescale the estimate. On a scalar plant, the error is no smaller than that of exact Bayes, and smaller
/// than that of the prior.
///
/// The accuracy is not judged beyond that; [`grid_bayes`] measures it. The equations are not checked, so a missing
/// drift or a wrong sign may pass. [`same_expectations`] compares the expectation with another one.
///
/// # Panics
/// Panics if it does not conform.
pub fn check_expectation<E: ConditionalExpectations<Scalar = f64>>() {
    allocations::a_step_allocates_nothing(&Variant::of::<BiermanUd<Plain<f64>>, E>());
    properties::check_expectation::<E>();
    let (found, prior) = (grid_bayes::<E>(0.1, 0.5, 100), ScalarPrior::default());
    // The true parameters are drawn at random, so over 100 runs an approximation may be better by one per cent by
    // chance.
    assert!(found.rmse > 0.97 * found.exact_rmse, "better than exact Bayes, which cannot be: {found:?}");
    assert!(found.rmse < 0.7 * prior.a.1.sqrt(), "the estimate hardly learns from the record: {found:?}");
    assert!(found.nees.is_finite() && found.nees > 0.0, "{found:?}");
}

/// Structures (observability indices, number of inputs) on which two expectations are compared.
const STRUCTURES: [(&[usize], usize); 3] = [(&[2, 1], 2), (&[3], 1), (&[1, 2, 2], 3)];

/// Largest relative difference that rounding causes between two implementations of one expectation.
const SAME: f64 = 1e-9;

/// Compares two expectations that these options make equal, such as an expectation of your own and a built-in one. It
/// compares estimate and covariance after random records with missing outputs and changing noise, whose six
/// covariances are all present.
///
/// ```
/// use plid_variants::expectations::{Posterior, Prior};
///
/// plid_testkit::same_expectations::<Prior<f64>, Prior<f64>>(&(), &());
/// let differ = || plid_testkit::same_expectations::<Prior<f64>, Posterior<f64>>(&(), &());
/// assert!(std::panic::catch_unwind(differ).is_err());
/// ```
///
/// # Panics
/// Panics if they differ by more than rounding.
pub fn same_expectations<A, B>(a: &A::Options, b: &B::Options)
where
    A: ConditionalExpectations<Scalar = f64>,
    B: ConditionalExpectations<Scalar = f64>,
{
    for (seed, (indices, inputs)) in (1..).zip(STRUCTURES) {
        let options = Options { steps: 100, noise_scale: 0.1, noise_models: 2, missing: 0.2, full_initial: true };
        let case = random_case(indices, inputs, options, seed);
        let (s, p) = outcome(&finish_with::<BiermanUd<Plain<f64>>>(&case, |model| Box::new(A::new(model, a))));
        let (s_b, p_b) = outcome(&finish_with::<BiermanUd<Plain<f64>>>(&case, |model| Box::new(B::new(model, b))));
        let (ds, dp) = (relative(&s, &s_b), relative(&p, &p_b));
        assert!(ds < SAME && dp < SAME, "indices {indices:?}: relative differences of s {ds:.1e} and of P {dp:.1e}");
    }
}
