//! Merging of runs, in each of which a single input acts, into one model of all inputs.
//!
//! All runs share A, and each has its own columns of B. [`combine()`] multiplies their Gaussian posteriors and counts
//! the common prior once; [`consistency()`] tests whether the runs share A. Both operate on indices of parameters and
//! are independent of the structure of A and B.

mod carry_out;
mod combine;
mod consistency;
mod error;
mod finished;
mod held_out;
mod knowledge;
mod merged;
mod output;
mod report;
mod runs;
mod split;
#[cfg(test)]
mod tests;
mod tune;

pub use carry_out::{Outcome, carry_out, of_runs};
pub use combine::{Combined, combine};
pub use consistency::{Agreement, Consistency, Departure, LEVEL, consistency};
pub use error::MergeError;
pub use finished::FinishedRun;
pub use held_out::HeldOut;
pub use knowledge::Knowledge;
pub use merged::{Merged, REST, merge};
pub use output::write;
pub use report::verdict;
