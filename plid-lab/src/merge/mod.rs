//! Runs in which one input acts at a time, merged into one model of all inputs.
//!
//! All runs share A; each has B columns of its own. [`combine()`] joins their Gaussians with the prior counted once, [`consistency()`] tests that
//! they do share A. Both know nothing of A and B, only of places among parameters.

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
