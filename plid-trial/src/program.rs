//! The program that drew, diagnosed or scored a trial.

use std::fmt;
use std::path::Path;
use std::sync::OnceLock;

use plid_file::sha256;
use plid_gap::settings::GapSettings;
use serde::{Deserialize, Serialize};

use crate::error::TrialError;
use crate::files;

/// A build of the program. Two builds of one commit differ if their executables do.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Program {
    /// The version of the package.
    pub version: String,
    /// The commit of the repository in which it was built; `None` outside a repository.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub commit: Option<String>,
    /// Whether the files under version control differed from that commit.
    pub dirty: bool,
    /// SHA-256 of the executable.
    pub executable_sha256: String,
    /// SHA-256 of the settings of the diagnosis if a case does not change them, as JSON; empty in files of earlier
    /// versions. Each answer contains all of its settings.
    #[serde(default)]
    pub settings_sha256: String,
}

impl Program {
    /// Returns the running program.
    ///
    /// # Errors
    /// Returns an error if the program's own executable cannot be read.
    pub fn this() -> Result<Self, TrialError> {
        static THIS: OnceLock<Program> = OnceLock::new();
        if let Some(program) = THIS.get() {
            return Ok(program.clone());
        }
        let executable_sha256 = plid_file::executable_sha256().map_err(TrialError::file("the program's executable"))?;
        let program = Self {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            commit: option_env!("PLID_COMMIT").map(str::to_owned),
            dirty: option_env!("PLID_CHANGED") == Some("true"),
            executable_sha256,
            settings_sha256: sha256(&files::json(Path::new("settings"), &GapSettings::default())?),
        };
        Ok(THIS.get_or_init(|| program).clone())
    }
}

impl fmt::Display for Program {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "plid {}", self.version)?;
        if let Some(commit) = &self.commit {
            write!(f, " of commit {}", commit.get(..12).unwrap_or(commit))?;
        }
        if self.dirty {
            write!(f, " with changes")?;
        }
        write!(f, " (executable {})", self.executable_sha256.get(..8).unwrap_or(&self.executable_sha256))
    }
}
