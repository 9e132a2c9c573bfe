//! Reading files, and writing them atomically.

use std::path::Path;

use plid_file::{to_json, write_atomic};
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::error::TrialError;

/// Returns the bytes of a JSON file; `path` is its name in errors.
pub(crate) fn json(path: &Path, value: &impl Serialize) -> Result<Vec<u8>, TrialError> {
    let text = to_json(value).map_err(|source| TrialError::NotFinite { path: path.into(), source })?;
    Ok(text.into_bytes())
}

pub(crate) fn write_json(path: &Path, value: &impl Serialize) -> Result<(), TrialError> {
    write(path, &json(path, value)?)
}

pub(crate) fn write(path: &Path, bytes: &[u8]) -> Result<(), TrialError> {
    write_atomic(path, bytes).map_err(TrialError::file(path))
}

pub(crate) fn read(path: &Path) -> Result<Vec<u8>, TrialError> {
    std::fs::read(path).map_err(TrialError::file(path))
}

pub(crate) fn parse<T: DeserializeOwned>(path: &Path, bytes: &[u8]) -> Result<T, TrialError> {
    serde_json::from_slice(bytes).map_err(|e| TrialError::Malformed { path: path.into(), reason: e.to_string() })
}

pub(crate) fn make(directory: &Path) -> Result<(), TrialError> {
    std::fs::create_dir_all(directory).map_err(TrialError::file(directory))
}
