//! The study of stability. It shows how long P remains a covariance, and how far rounding moves an identification
//! from the result of exact arithmetic.
//!
//! [`carry_out`] runs the cells, [`Outcome`] holds the results, and [`write_all`] writes the files.

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

use crate::study::{Progress, Shard, StudyError};

/// Runs the study. With `resume`, cells in the journal in `directory` are not repeated.
///
/// # Errors
/// Returns a [`StudyError`]; an interrupted study leaves its journal.
pub fn carry_out(
    config: &Config,
    directory: &Path,
    resume: bool,
    progress: &dyn Progress,
) -> Result<Outcome, StudyError> {
    let machine = crate::study::Machine::here();
    Outcome::new(config.clone(), machine, study::run(config, directory, None, resume, progress)?)
}

/// Runs the cells of a shard in its own folder in `directory`.
///
/// # Errors
/// Returns the errors of [`carry_out`].
pub fn run_shard(
    config: &Config,
    directory: &Path,
    shard: Shard,
    resume: bool,
    progress: &dyn Progress,
) -> Result<(), StudyError> {
    crate::study::shard(directory, shard, |folder| {
        study::run(config, folder, Some(shard), resume, progress).map(|_| ())
    })
}

/// Copies the cells of all shards to the journal in `directory`, where [`carry_out`] resumes with nothing left to
/// run.
///
/// # Errors
/// Returns [`StudyError::Shards`] if a shard is missing or not complete, or the error of a file.
pub fn merge(config: &Config, directory: &Path) -> Result<usize, StudyError> {
    study::merge(config, directory)
}

/// Writes report.html, stability.csv, stability.json, machine.json and config.toml.
///
/// # Errors
/// Returns [`StudyError::NotFinite`] or [`StudyError::File`].
pub fn write_all(outcome: &Outcome, directory: &Path) -> Result<(), StudyError> {
    outcome.write(directory)
}
