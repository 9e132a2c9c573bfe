//! How long P stays a covariance, and how far rounding takes an identification from what exact arithmetic would give.
//!
//! [`carry_out`] runs the cells, [`Outcome`] is what came of them, [`write_all`] makes its files.

mod adversarial;
mod cell;
mod classify;
mod config;
mod covariance;
mod grid;
mod group;
mod outcome;
mod plant;
mod problem;
mod record;
mod reference;
mod report;
mod scenario;
mod study;
mod table;
mod verdicts;

use std::path::Path;

pub use cell::{Cell, ErrorAt, Indefinite, LocalAt, Stop};
pub use classify::{Class, Judged, rule};
pub use config::{Adversarial, BENCH, Config, FULL, Long, QUICK, Variations};
pub use group::{Group, Part};
pub use outcome::Outcome;
pub use reference::ReferenceSummary;
pub use scenario::Scenario;
pub use verdicts::{Claim, Recommended};

use crate::study::{Progress, StudyError};

/// Runs the study; what its journal in `directory` has already is not run again with `resume`.
///
/// # Errors
/// [`StudyError`]; interrupted work leaves its journal.
pub fn carry_out(
    config: &Config,
    directory: &Path,
    resume: bool,
    progress: &dyn Progress,
) -> Result<Outcome, StudyError> {
    let machine = crate::study::Machine::here();
    Outcome::new(config.clone(), machine, study::run(config, directory, resume, progress)?)
}

/// Writes report.html, stability.csv, stability.json, machine.json and config.toml.
///
/// # Errors
/// [`StudyError::File`]
pub fn write_all(outcome: &Outcome, directory: &Path) -> Result<(), StudyError> {
    outcome.write(directory)
}
