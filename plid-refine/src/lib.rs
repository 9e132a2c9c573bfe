//! Estimation of linear models for simulation by nonrecursive methods, which refine a recursive estimate or serve as
//! its reference.
//!
//! - [`subspace`] estimates a model from the records alone and makes it stable;
//! - [`exact`] identifies the system itself from noise-free records;
//! - [`refine`] computes the output-error estimate from a starting model, stable by construction, with its covariance;
//! - [`slower_start`] finds a starting model for records that are sampled much faster than they change;
//! - [`best_of`] selects among several starting models on reserved training data;
//! - [`slowest_radius`] limits the slowest pole;
//! - [`fit_predictor`] fits the gain of the one-step predictor.
//!
//! Records are samples x channels in their own units; a NaN among the outputs is a missing sample. Results are
//! bit-identical for any number of threads.

mod choose;
mod error;
mod exact;
mod gram;
mod memory;
mod normal;
mod point;
mod predictor;
mod record;
mod refine;
mod sections;
mod slower;
mod subspace;
mod uncertainty;
mod whiten;

pub use choose::{Candidate, Choice, Score, best_of, free_run_error, head};
pub use error::RefineError;
pub use exact::{Exact, exact};
pub use memory::{period, slowest_radius};
pub use predictor::{Predictor, fit_predictor};
pub use record::{Record, Start};
pub use refine::{Noise, Options, Refined, Watcher, refine};
pub use slower::slower_start;
pub use subspace::{Subspace, subspace};
pub use uncertainty::Uncertainty;
