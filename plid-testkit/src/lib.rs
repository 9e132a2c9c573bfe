//! Conformance tests for anybody's covariance form, conditional expectation or backend.
//!
//! A test of one line holds a type to what plid's own variants are held to:
//!
//! ```
//! use plid_backends::Plain;
//! use plid_variants::covariance::BiermanUd;
//!
//! plid_testkit::check_scalar_update::<BiermanUd<Plain<f64>>>();
//! ```
//!
//! - [`check_form`]: the dense recursion in double-double, positivity, checkpoints, missing outputs, permuted and
//!   rescaled channels, forgetting, parameter noise, a warm start, and no allocation in a step.
//! - [`check_expectation`]: the same properties as far as they hold for any expectation, and exact Bayes on a grid.
//! - [`check_backend`]: all of plid's forms on the backend.
//! - [`check_scalar_update`]: the measurement update by any row.
//!
//! Each panics with the figures where something is wrong. The crate counts allocations, and so brings the global
//! allocator of `allocation-counter` into the program that links it: make it a dev-dependency.

/// Makes every form and expectation of the lists into a call of `check::<form, expectation>(arguments)` over one
/// backend.
#[macro_export]
macro_rules! every_variant {
    ($check:ident, $backend:ident < $scalar:ty > $(, $argument:expr)*) => {{
        #[allow(unused_imports)]
        use {$crate::variants::covariance::*, $crate::backends::$backend};
        $crate::variants::every_form!(each_form, $check, $backend, [$scalar], [$($argument),*]);
    }};
}

/// One form of [`every_variant!`].
#[doc(hidden)]
#[macro_export]
macro_rules! each_form {
    ($check:ident $backend:ident [$scalar:ty] $arguments:tt $($(#[$doc:meta])* $word:literal = $form:ident;)*) => {
        $($crate::every_expectation_of!($check, $form<$backend<$scalar>>, $scalar, $arguments);)*
    };
}

/// `check::<form, expectation>(arguments)` for every expectation of the list.
#[macro_export]
macro_rules! every_expectation_of {
    ($check:ident, $form:ty, $scalar:ty, $arguments:tt) => {{
        use $crate::variants::expectations::*;
        $crate::variants::every_expectation!(each_expectation, $check, [$form], [$scalar], $arguments);
    }};
}

/// One expectation of [`every_expectation_of!`].
#[doc(hidden)]
#[macro_export]
macro_rules! each_expectation {
    ($check:ident [$form:ty] [$scalar:ty] $arguments:tt $($(#[$doc:meta])* $word:literal = $expectation:ident;)*) => {
        $($crate::each_expectation!(@call $check [$form] [$scalar] $arguments $expectation);)*
    };
    (@call $check:ident [$form:ty] [$scalar:ty] [$($argument:expr),*] $expectation:ident) => {
        $check::<$form, $expectation<$scalar>>($($argument),*)
    };
}

/// One `#[test]` a backend and scalar, each for every form and expectation.
#[macro_export]
macro_rules! test_every_variant {
    ($check:ident: $($name:ident = $backend:ident < $scalar:ty >),* $(,)?) => {
        mod $check {
            use super::$check;
            use $crate::{each_expectation, each_form};
            $(
                #[test]
                fn $name() {
                    $crate::every_variant!($check, $backend<$scalar>);
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
mod warm_start;

pub use algebra::{bierman, check_scalar_update, dyer_mcreynolds};
pub use expectation::{Calibration, check_expectation, grid_bayes};

use plid_core::{Backend, Form, Scalar, ScalarOf};

#[doc(hidden)]
pub use {plid_backends as backends, plid_variants as variants};

/// Holds a covariance form to what plid's own forms are held to, with each of plid's conditional expectations.
///
/// # Panics
/// Where it does not conform.
pub fn check_form<C: Form>() {
    every_expectation_of!(of_the_dense_recursion, C, ScalarOf<C>, []);
    every_expectation_of!(of_allocations, C, ScalarOf<C>, []);
    if ScalarOf::<C>::EPSILON < 1e-10 {
        every_expectation_of!(of_one_step, C, ScalarOf<C>, []);
        warm_start::goes_on::<C>();
        properties::check::<C>();
        properties::parameter_noise_adds_up::<C>();
    }
    properties::checkpoints::<C>();
}

use allocations::a_step_allocates_nothing as of_allocations;
use oracle::{agrees_with_the_dense_recursion as of_the_dense_recursion, one_step_is_eq_8_to_10 as of_one_step};

/// Holds all of plid's forms to [`check_form`] on a backend.
///
/// # Panics
/// Where a form does not conform on it.
pub fn check_backend<B: Backend>() {
    use plid_variants::covariance::*;
    macro_rules! each {
        ($($(#[$doc:meta])* $word:literal = $form:ident;)*) => { $(check_form::<$form<B>>();)* };
    }
    plid_variants::every_form!(each);
}
