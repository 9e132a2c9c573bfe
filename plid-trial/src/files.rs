//! Files in and out, each whole or not at all.

use std::path::Path;

use plid_report::write_atomic;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::error::TrialError;

pub(crate) fn json(value: &impl Serialize) -> Vec<u8> {
    let mut text = serde_json::to_vec_pretty(value).expect("plain data are JSON by construction");
    text.push(b'\n');
    text
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
