//! Vallone and Hopkins (1995), figure by figure and claim by claim, on the simulated truss.
//!
//! A [`Claim`] is the paper's statement, a config under `experiments/paper/` and a function that puts the statement to the test;
//! one file a claim, under `claims`. Its [`Finding`] has figures, pictures and the parts into which the statement falls, each with the
//! rule by which it holds; the [`Verdict`] follows from the parts. [`reproduce()`] runs them, keeps each finding as soon as it is
//! there, and writes the page.

mod claim;
mod claims;
mod course;
mod page;
mod reproduce;
mod truss;

pub use claim::{Claim, Context, Figure, Finding, Panel, Part, Result, Verdict};
pub use claims::CLAIMS;
pub use page::{CAVEAT, Line};
pub use reproduce::{Options, Summary, reproduce};
