//! What can be set: thresholds, and steps of the diagnosis that can be switched off.

pub(crate) mod step;
pub(crate) mod thresholds;
