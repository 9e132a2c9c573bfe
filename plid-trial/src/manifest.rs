//! What a trial says of itself, in the open and under seal.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::config::TrialConfig;
use crate::error::TrialError;
use crate::files;
use crate::plan::Arm;
use crate::program::Program;
use crate::seal::{salt, sha256};

/// T/trial.json, written last: all that the cases say of what is withheld.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Manifest {
    /// "plid-trial".
    pub format: String,
    /// In the order of their names.
    pub cases: Vec<OpenCase>,
}

/// A case as a diagnosis may see it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct OpenCase {
    /// Folder in T/cases and in S/cases.
    pub case: String,
    /// Effects without which this case is answered a second time. With some cases these are not at work, so that the list does not tell what is.
    pub without: Vec<String>,
    /// SHA-256 of the files of the case's folder, by name.
    pub files: BTreeMap<String, String>,
    /// Salted hashes of the sealed files, by name.
    pub sealed: BTreeMap<String, String>,
}

/// S/seal.json, written last.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Seal {
    /// "plid-trial-seal".
    pub format: String,
    /// From which everything was drawn.
    pub seed: u64,
    /// Of the hashes.
    pub salt: String,
    /// Of T/trial.json.
    pub trial_sha256: String,
    /// Draws that were repeated, because no strength made the gap asked for or a nuisance could have made it.
    pub repeated: usize,
    /// The program that drew it.
    pub program: Program,
    /// What was asked for.
    pub config: TrialConfig,
}

/// S/cases/CASE/drawn.json.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct DrawnCase {
    /// Why it was drawn.
    pub arm: Arm,
    /// Of the testbed.
    pub seed: u64,
    /// What was asked of the testbed.
    pub spec: plid_testbed::gap::GapSpec,
    /// Gap that the noise alone makes.
    pub floor: f64,
}

pub(crate) const MANIFEST: &str = "trial.json";
pub(crate) const SEAL: &str = "seal.json";
pub(crate) const FORMAT: &str = "plid-trial";
pub(crate) const SEAL_FORMAT: &str = "plid-trial-seal";
/// The sealed files of a case.
pub(crate) const SEALED: [&str; 4] = ["drawn.json", "label.json", "test_u.csv", "test_uy.csv"];

impl Manifest {
    /// Reads T/trial.json.
    pub(crate) fn read(trial: &Path) -> Result<Self, TrialError> {
        let path = trial.join(MANIFEST);
        let read: Self = files::parse(&path, &files::read(&path)?)?;
        let wrong = |reason: String| TrialError::Malformed { path: path.clone(), reason };
        if read.format != FORMAT {
            return Err(wrong(format!("format: `{}` is not `{FORMAT}`", read.format)));
        }
        // A name is joined to paths: it must be a plain one.
        let plain = |name: &str| !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '-');
        if let Some(bad) = read.cases.iter().find(|case| !plain(&case.case)) {
            return Err(wrong(format!("case: `{}` is no name of a case", bad.case)));
        }
        Ok(read)
    }
}

impl OpenCase {
    /// The case's folder.
    pub(crate) fn folder(&self, trial: &Path) -> PathBuf {
        trial.join("cases").join(&self.case)
    }

    /// SHA-256 of the files of a folder, by name.
    pub(crate) fn hashes(folder: &Path) -> Result<BTreeMap<String, String>, TrialError> {
        let entries = std::fs::read_dir(folder).map_err(TrialError::file(folder))?;
        entries
            .map(|entry| {
                let path = entry.map_err(TrialError::file(folder))?.path();
                let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
                // What is no file is none that was drawn.
                let hash = if path.is_file() { sha256(&files::read(&path)?) } else { String::new() };
                Ok((name, hash))
            })
            .collect()
    }

    /// Whether the case's folder has the files that were drawn and no others.
    pub(crate) fn check(&self, trial: &Path) -> Result<(), TrialError> {
        let folder = self.folder(trial);
        let found = Self::hashes(&folder)?;
        let mut names = self.files.keys().chain(found.keys());
        match names.find(|name| self.files.get(*name) != found.get(*name)) {
            Some(name) => Err(TrialError::Altered { case: self.case.clone(), path: folder.join(name) }),
            None => Ok(()),
        }
    }
}

impl Seal {
    /// Reads S/seal.json.
    pub(crate) fn read(sealed: &Path) -> Result<Self, TrialError> {
        let path = sealed.join(SEAL);
        let read: Self = files::parse(&path, &files::read(&path)?)?;
        if read.format != SEAL_FORMAT {
            let reason = format!("format: `{}` is not `{SEAL_FORMAT}`", read.format);
            return Err(TrialError::Malformed { path, reason });
        }
        if salt(read.seed) != read.salt {
            let reason = format!("seed: {} is not the one that the salt was made from", read.seed);
            return Err(TrialError::Malformed { path, reason });
        }
        Ok(read)
    }
}

/// The config that a trial was drawn from, for whoever holds what is sealed.
///
/// # Errors
/// If S/seal.json cannot be read.
pub fn config_of(sealed: &Path) -> Result<TrialConfig, TrialError> {
    Ok(Seal::read(sealed)?.config)
}
