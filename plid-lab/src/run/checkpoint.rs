//! The checkpoint that an interrupted run writes and `--resume` reads.

use std::fs::File;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::error::RunError;
use super::output::{MANIFEST, RESULT};
use crate::experiment::{Experiment, to_toml};
use crate::identify::{Memory, Paused};
use plid_file::{Hashing, sha256, to_line, write_atomic};

/// The name of the checkpoint in the output directory.
pub const CHECKPOINT: &str = "checkpoint.json";

/// The filters already scored, and the state of the interrupted recursion.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Saved {
    /// The [`identity`] of the experiment and its files, to which the checkpoint belongs.
    experiment_sha256: String,
    pub(crate) memory: Memory,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) paused: Option<Paused>,
}

/// Returns SHA-256 over the experiment as requested and the bytes of every file that it names (relative to `base`). A
/// resumed run must have the same identity as the interrupted one.
pub(crate) fn identity(experiment: &Experiment, base: &Path) -> Result<String, RunError> {
    let mut parts = to_toml(experiment).into_bytes();
    for file in experiment.files() {
        let path = base.join(file);
        let digest = File::open(&path).and_then(|file| Hashing::new(file).digest());
        parts.extend(digest.map_err(|source| RunError::File { path, source })?);
    }
    Ok(sha256(parts))
}

/// Checks that a resumed run of `experiment` may write into `directory`. A checkpoint contains its own identity.
/// Without a checkpoint, there may be a finished run, which must be of the same experiment and the same data.
///
/// # Errors
/// Returns [`RunError::Checkpoint`] if the directory holds a finished run of another experiment or of other data.
pub fn require_own(experiment: &Experiment, base: &Path, directory: &Path) -> Result<(), RunError> {
    let result = directory.join(RESULT);
    if directory.join(CHECKPOINT).exists() || !result.exists() || is_finished(directory, &identity(experiment, base)?) {
        return Ok(());
    }
    let reason = "this folder holds a finished run of another experiment or of other data; `--force` overwrites it";
    Err(RunError::Checkpoint { path: result, reason: reason.into() })
}

/// Whether `directory` holds a finished run of this identity. The manifest of a run states it; a merge has no manifest
/// and states it in its result.
pub(crate) fn is_finished(directory: &Path, identity: &str) -> bool {
    let says = |name: &str| {
        let text = std::fs::read(directory.join(name)).ok()?;
        let value: serde_json::Value = serde_json::from_slice(&text).ok()?;
        Some(value["identity_sha256"] == identity)
    };
    directory.join(RESULT).exists() && [MANIFEST, RESULT].into_iter().any(|name| says(name) == Some(true))
}

/// Reads the checkpoint of a run of this identity in `directory`. Without a checkpoint, the run starts from the
/// beginning.
pub(crate) fn read(directory: &Path, identity: &str) -> Result<Saved, RunError> {
    let path = directory.join(CHECKPOINT);
    let bad = |reason: String| RunError::Checkpoint { path: path.clone(), reason };
    let text = match std::fs::read_to_string(&path) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Saved::default()),
        Err(error) => return Err(bad(error.to_string())),
    };
    let saved: Saved = serde_json::from_str(&text).map_err(|e| bad(format!("not a checkpoint: {e}")))?;
    if saved.experiment_sha256 != identity {
        return Err(bad("it belongs to another experiment, or the config or a data file has changed since".into()));
    }
    Ok(saved)
}

/// Writes the checkpoint and returns [`RunError::Interrupted`] with its path.
pub(crate) fn write(directory: Option<&Path>, identity: &str, memory: Memory, paused: Option<Paused>) -> RunError {
    let Some(directory) = directory else { return RunError::Identify(crate::identify::IdentifyError::Interrupted) };
    save(directory, &Saved { experiment_sha256: identity.into(), memory, paused })
}

/// Writes the state from which a run continues. A state with a number that is not finite could not be read back and
/// is refused.
fn save(directory: &Path, saved: &impl Serialize) -> RunError {
    let checkpoint = directory.join(CHECKPOINT);
    let text = match to_line(saved) {
        Ok(text) => text,
        Err(source) => return RunError::NotFinite { path: checkpoint, source },
    };
    let written = std::fs::create_dir_all(directory).and_then(|()| write_atomic(&checkpoint, text.as_bytes()));
    match written {
        Ok(()) => RunError::Interrupted { checkpoint },
        Err(source) => RunError::File { path: checkpoint, source },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    #[test]
    fn a_state_that_is_not_finite_is_not_written() {
        let directory = tempfile::tempdir().unwrap();
        let refused = save(directory.path(), &BTreeMap::from([("estimate", [1.0, f64::NAN])])).to_string();
        assert!(refused.contains("checkpoint.json: `estimate[1]` is NaN"), "{refused}");
        assert!(!directory.path().join(CHECKPOINT).exists());
        let written = write(Some(directory.path()), "one", Memory::default(), None);
        assert!(matches!(written, RunError::Interrupted { .. }), "{written}");
        assert_eq!(read(directory.path(), "one").unwrap().memory, Memory::default());
    }
}
