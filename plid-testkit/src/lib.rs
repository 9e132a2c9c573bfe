//! Conformance tests for user-defined covariance forms, conditional expectations and backends.
//!
//! A one-line test runs plid's own conformance tests on a type:
//!
//! ```
//! use plid_backends::Plain;
//! use plid_variants::covariance::BiermanUd;
//!
//! plid_testkit::check_scalar_update::<BiermanUd<Plain<f64>>>();
//! ```
//!
//! - [`check_form`]: comparison with the dense recursion in double-double, positivity, checkpoints, missing outputs,
//!   permuted and rescaled channels, forgetting, parameter noise, a warm start, and no allocation in a step.
//! - [`check_expectation`]: those of these properties that hold for any expectation, and comparison with exact Bayes
//!   on a grid.
//! - [`same_expectations`]: two expectations that should be equal.
//! - [`check_backend`]: all of plid's forms on the backend.
//! - [`check_scalar_update`]: the measurement update by any row.
//!
//! Each panics with the figures if something is wrong. The crate counts allocations and therefore installs the global
//! allocator of `allocation-counter` in the program that links it: make it a dev-dependency.

/// Defines one `#[test]` per backend. It calls `check`, which takes a [`run::Variant`], for each form with each
/// expectation.
#[macro_export]
macro_rules! test_every_variant {
    ($check:ident: $($name:ident = $backend:ty),* $(,)?) => {
        mod $check {
            use super::*;
            $(
                #[test]
                fn $name() {
                    $crate::run::every_variant::<$backend>().iter().for_each(super::$check);
                }
            )*
        }
    };
}

mod algebra;
mod allocations;
pub mod case;
mod dense;
mod expectation;
mod oracle;
mod properties;
mod reference;
pub mod run;
pub mod scalar_case;
mod warm_start;

pub use algebra::{bierman, check_scalar_update, dyer_mcreynolds};
pub use expectation::{Calibration, check_expectation, grid_bayes, same_expectations};

use plid_core::{Backend, Form, Scalar, ScalarOf};
use reference::Kind;

/// Checks a covariance form as plid's own forms are checked, with each of plid's conditional expectations. Forgetting
/// and parameter noise are checked if the form supports them.
///
/// # Panics
/// Panics if it does not conform.
pub fn check_form<C: Form>() {
    let variants = run::with_every_expectation::<C>();
    variants.iter().for_each(oracle::agrees_with_the_dense_recursion);
    variants.iter().for_each(allocations::a_step_allocates_nothing);
    if ScalarOf::<C>::EPSILON < 1e-10 {
        variants.iter().for_each(oracle::one_step_is_eq_8_to_10);
        variants.iter().filter(|variant| variant.kind() == Kind::MomentMatched).for_each(warm_start::goes_on);
        properties::check(&variants);
        properties::parameter_noise_adds_up::<C>();
    }
    properties::checkpoints(&variants);
}

/// Checks all of plid's forms on a backend with [`check_form`].
///
/// # Panics
/// Panics if a form does not conform on it.
pub fn check_backend<B: Backend>() {
    use plid_variants::covariance::*;
    macro_rules! each {
        ($($(#[$doc:meta])* $word:literal = $form:ident;)*) => { $(check_form::<$form<B>>();)* };
    }
    plid_variants::every_form!(each);
}
