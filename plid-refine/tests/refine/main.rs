//! The subspace estimate, its refinement, and the covariance.

mod common;
mod covariance;
mod exact;
mod refine;
mod subspace;
