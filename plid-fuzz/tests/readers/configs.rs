//! Experiments, cases and trials.

use std::fmt::Debug;

use plid_data::config::{from_toml_checked, to_toml};
use plid_gap::case::CaseConfig;
use plid_lab::experiment::Experiment;
use plid_trial::TrialConfig;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::{fuzz, require_same, words};

/// Reads a strict TOML file, whose values are read back the same.
pub fn read<T>(bytes: &[u8], problems: fn(&T) -> Vec<(&'static str, String)>) -> String
where
    T: Serialize + DeserializeOwned + PartialEq + Debug,
{
    let Ok(text) = std::str::from_utf8(bytes) else { return "no text".into() };
    let read = from_toml_checked(text, "x.toml", problems);
    if let Ok(value) = &read {
        let written = to_toml(value);
        require_same(value, &written, from_toml_checked(&written, "again.toml", problems));
    }
    words(read)
}

#[cfg_attr(test, test)]
pub fn experiment() {
    fuzz("experiment", 2000, 5000, |bytes| read(bytes, Experiment::problems));
}

#[cfg_attr(test, test)]
pub fn case() {
    fuzz("case", 2000, 5000, |bytes| read(bytes, CaseConfig::problems));
}

#[cfg_attr(test, test)]
pub fn trial() {
    fuzz("trial", 2000, 5000, |bytes| read(bytes, TrialConfig::problems));
}
