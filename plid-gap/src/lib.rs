//! Finds where a simulation disagrees with its records, which unmodelled effect causes the disagreement, and how far
//! the gap shrinks once the effect is added.
//!
//! A case passes through the modules in this order. It is read (`case`), and its simulation is decomposed into modes
//! (`plant`). The noise is estimated (`signal`, `noise`), effects (`effects`) are simulated (`simulate`), and a
//! least-squares problem (`fit`) is prepared (`prepare`). Explanations are searched for (`search`) and judged
//! (`judge`); `evidence` is collected and does not enter the verdict. The result is written as an answer (`answer`) and
//! a report (`report`). `audit` checks and corrects the input, and `diagnose` calls all of them. A module imports only
//! modules below it in the order of `tests/gap/order.rs`.

pub mod answer;
mod audit;
pub mod case;
pub mod diagnose;
pub mod effects;
mod error;
mod evidence;
mod fit;
pub mod in_loop;
mod judge;
mod noise;
mod plant;
mod prepare;
pub mod report;
pub mod research;
/// The calibration of stated probabilities by trials.
pub mod calibration {
    pub use crate::judge::calibration::{Calibration, Coefficients, Learnt, MOST_LOG_ODDS, log_odds};
    pub use crate::judge::statistics::CONFIDENCE;
}
mod search;
pub mod settings;
mod signal;
mod simulate;
#[cfg(test)]
mod testing;
mod words;

pub use diagnose::{Groundwork, Outcome, Shown, diagnose, diagnose_without};
pub use error::GapError;
pub use report::write;
pub use settings::step::Step;
