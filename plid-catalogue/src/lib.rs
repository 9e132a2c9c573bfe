//! All forms, expectations, backends and scalars by name, and which form to take.
//!
//! A crate of its own, and tested from outside, so that the many combinations are compiled once.
mod recommendation;
mod variant;

pub use recommendation::{Conditions, START_RATIO, STATES, STEPS, VariantChoice};
pub use variant::{BackendName, Built, CovarianceName, ExpectationName, Recursion, ScalarName, Variant, VariantError};
