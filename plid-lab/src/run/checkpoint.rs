//! The checkpoint that an interrupted run writes and `--resume` reads.

use std::path::Path;

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::error::RunError;
use crate::experiment::{Experiment, to_toml};
use crate::identify::{Memory, Paused};
use plid_report::write_atomic;

/// The name of the checkpoint in the output directory.
pub const CHECKPOINT: &str = "checkpoint.json";

/// The filters already scored, and the state of the interrupted recursion.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Saved {
    /// The hash of the experiment to which the checkpoint belongs.
    experiment_sha256: String,
    pub(crate) memory: Memory,
    pub(super) paused: Option<Paused>,
}

fn hash(experiment: &Experiment) -> String {
    Sha256::digest(to_toml(experiment)).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Reads the checkpoint of `experiment` in `directory`; without one the run starts from the beginning.
pub(crate) fn read(directory: &Path, experiment: &Experiment) -> Result<Saved, RunError> {
    let path = directory.join(CHECKPOINT);
    let bad = |reason: String| RunError::Checkpoint { path: path.clone(), reason };
    let text = match std::fs::read_to_string(&path) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Saved::default()),
        Err(error) => return Err(bad(error.to_string())),
    };
    let saved: Saved = serde_json::from_str(&text).map_err(|e| bad(format!("not a checkpoint: {e}")))?;
    if saved.experiment_sha256 != hash(experiment) {
        return Err(bad("it belongs to another experiment, or the config has changed since".into()));
    }
    Ok(saved)
}

/// Writes the checkpoint and returns [`RunError::Interrupted`] with its path.
pub(crate) fn write(
    directory: Option<&Path>,
    experiment: &Experiment,
    memory: Memory,
    paused: Option<Paused>,
) -> RunError {
    let Some(directory) = directory else { return RunError::Identify(crate::identify::IdentifyError::Interrupted) };
    let checkpoint = directory.join(CHECKPOINT);
    let saved = Saved { experiment_sha256: hash(experiment), memory, paused };
    let text = serde_json::to_vec(&saved).expect("a checkpoint is plain numbers");
    let written = std::fs::create_dir_all(directory).and_then(|()| write_atomic(&checkpoint, &text));
    match written {
        Ok(()) => RunError::Interrupted { checkpoint },
        Err(source) => RunError::File { path: checkpoint, source },
    }
}
