//! All forms, expectations, backends and scalars by name, and the recommended form.
//!
//! This is a separate crate that is tested from outside, so that the variants are compiled only once.
pub mod count;
mod names;
mod recommendation;
mod registry;
mod variant;

pub use names::{BackendName, CovarianceName, ExpectationName, ScalarName};
pub use plid_core::AnyForm;
pub use plid_core::Backend;
pub use plid_core::kernels::Kernels;
pub use recommendation::{Conditions, START_RATIO, STATES, STEPS, VariantChoice};
pub use registry::{
    BackendEntry, Entry, ExpectationEntry, ExpectationFamily, FormEntry, FormFamily, Number, PairEntry,
};
pub use variant::{Built, Recursion, Variant, VariantError};
