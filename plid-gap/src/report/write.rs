//! The files of a diagnosis.

use std::path::Path;

use plid_report::write_atomic;
use serde::Serialize;

use crate::case::Case;
use crate::diagnose::Outcome;
use crate::error::GapError;
use crate::report;

/// Writes diagnosis.json, sim-with-effect.json and report.html into a directory, each whole or not at all.
///
/// # Errors
/// [`GapError::Io`] with the file.
pub fn write(outcome: &Outcome, case: &Case, directory: &Path) -> Result<(), GapError> {
    json(&directory.join("sim-with-effect.json"), &outcome.simulation)?;
    let page = directory.join("report.html");
    report::page(outcome, case).write(&page).map_err(|source| GapError::Io { file: page, source })?;
    json(&directory.join("diagnosis.json"), &outcome.diagnosis)
}

fn json(path: &Path, value: &impl Serialize) -> Result<(), GapError> {
    let mut text = serde_json::to_string_pretty(value).expect("plain data are JSON by construction");
    text.push('\n');
    write_atomic(path, text.as_bytes()).map_err(|source| GapError::Io { file: path.into(), source })
}
