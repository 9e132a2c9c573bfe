//! The public and the sealed manifest of a trial.

use plid_file::sha256;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::config::TrialConfig;
use crate::error::TrialError;
use crate::files;
use crate::plan::Arm;
use crate::program::Program;
use crate::seal::salt;

/// The content of T/trial.json, which is written last. It contains everything that the cases reveal about the truth.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Manifest {
    /// "plid-trial".
    pub format: String,
    /// The cases in the order of their names.
    pub cases: Vec<OpenCase>,
}

/// A case as a diagnosis may see it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct OpenCase {
    /// Folder in T/cases and in S/cases.
    pub case: String,
    /// Effects to leave out for a second answer to this case. In some cases they do not act, so that the list does not
    /// reveal the truth.
    pub without: Vec<String>,
    /// SHA-256 of the files of the case's folder, by name.
    pub files: BTreeMap<String, String>,
    /// Salted hashes of the sealed files, by name.
    pub sealed: BTreeMap<String, String>,
}

/// The content of S/seal.json, which is written after the cases and before T/trial.json.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Seal {
    /// "plid-trial-seal".
    pub format: String,
    /// The seed from which everything was drawn.
    pub seed: u64,
    /// The salt of the hashes.
    pub salt: String,
    /// SHA-256 of T/trial.json.
    pub trial_sha256: String,
    /// Number of draws that were repeated, because no strength gave the required gap or a nuisance could have caused
    /// it.
    pub repeated: usize,
    /// The program that drew the trial.
    pub program: Program,
    /// The config of the trial.
    pub config: TrialConfig,
}

/// The content of S/cases/CASE/drawn.json.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DrawnCase {
    /// The arm for which it was drawn.
    pub arm: Arm,
    /// The seed of the testbed.
    pub seed: u64,
    /// The specification given to the testbed.
    pub spec: plid_testbed::gap::GapSpec,
    /// Gap caused by noise alone.
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
        // A name is joined to paths, so it must be a plain one.
        let plain = |name: &str| !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '-');
        if let Some(bad) = read.cases.iter().find(|case| !plain(&case.case)) {
            return Err(wrong(format!("case: `{}` is not the name of a case", bad.case)));
        }
        Ok(read)
    }
}

impl OpenCase {
    /// Returns the case's folder.
    pub(crate) fn folder(&self, trial: &Path) -> PathBuf {
        trial.join("cases").join(&self.case)
    }

    /// Returns the SHA-256 of the files of a folder, by name.
    pub(crate) fn hashes(folder: &Path) -> Result<BTreeMap<String, String>, TrialError> {
        let entries = std::fs::read_dir(folder).map_err(TrialError::file(folder))?;
        entries
            .map(|entry| {
                let path = entry.map_err(TrialError::file(folder))?.path();
                let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
                // An entry that is not a file was not drawn, so it gets an empty hash.
                let hash = if path.is_file() { sha256(&files::read(&path)?) } else { String::new() };
                Ok((name, hash))
            })
            .collect()
    }

    /// Checks that the case's folder has the files that were drawn and no others.
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
            let reason = format!("seed: the salt was not made from {}", read.seed);
            return Err(TrialError::Malformed { path, reason });
        }
        Ok(read)
    }
}

/// Returns the config from which a trial was drawn, which requires the sealed directory.
///
/// # Errors
/// Returns an error if S/seal.json cannot be read.
pub fn config_of(sealed: &Path) -> Result<TrialConfig, TrialError> {
    Ok(Seal::read(sealed)?.config)
}
