//! The figures and claims of Vallone and Hopkins (1995), tested on the simulated truss.
//!
//! A [`Claim`] consists of the paper's statement, a config under `experiments/paper/` and a function that tests the
//! statement; each has a file under `claims`. Its [`Finding`] contains figures, plots and the parts of the statement,
//! each with the rule that decides whether it holds; the [`Verdict`] follows from the parts. [`reproduce()`] runs the
//! claims, saves each finding as soon as it is complete, and writes the page.

mod claim;
mod claims;
mod course;
mod page;
mod reproduce;
mod truss;

pub use claim::{Claim, Context, Figure, Finding, Panel, Part, Result, Verdict};
pub use claims::CLAIMS;
pub use page::{CAVEAT, Line};
pub use reproduce::{Done, Options, Summary, reproduce};
