//! Linear models for simulation: what a recursive estimate is refined to, and held against.
//!
//! - [`subspace`]: an estimate from the records alone, with unstable poles mended;
//! - [`exact`]: the system itself, where the records have no noise;
//! - [`refine`]: the output-error estimate from a start, stable by construction, with its covariance;
//! - [`best_of`]: several starts, of which a held-out slice of the training data takes the best;
//! - [`slowest_radius`]: the limit on the slowest pole.
//!
//! Records are samples x channels, in units of their own; a NaN among the outputs is a missing sample. Results repeat to the bit with any number of threads.

mod choose;
mod error;
mod exact;
mod gram;
mod memory;
mod normal;
mod point;
mod record;
mod refine;
mod sections;
mod subspace;
mod uncertainty;
mod whiten;

pub use choose::{Candidate, Choice, Score, best_of, free_run_error, head};
pub use error::RefineError;
pub use exact::{Exact, exact};
pub use memory::{period, slowest_radius};
pub use record::{Record, Start};
pub use refine::{Noise, Options, Refined, Watcher, refine};
pub use subspace::{Subspace, subspace};
pub use uncertainty::Uncertainty;
