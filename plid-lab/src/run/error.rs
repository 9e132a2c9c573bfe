//! What can go wrong in a run.

use std::path::PathBuf;

use crate::experiment::ConfigError;
use crate::identify::IdentifyError;
use plid_data::DataError;
use plid_data::prepare::PrepareError;
use plid_model::ModelError;
use plid_model::signal::SignalError;

/// A run that did not come to its end.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
pub enum RunError {
    /// The experiment file is wrong.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Config(#[from] ConfigError),
    /// A value of the experiment is wrong, or does not fit the data.
    #[error("{key}: {reason}")]
    Setting {
        /// The key.
        key: &'static str,
        /// What is wrong with it.
        reason: String,
    },
    /// A data file is wrong.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Data(#[from] DataError),
    /// The data cannot be prepared as asked for.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Prepare(#[from] PrepareError),
    /// The simulated truss refused its config.
    #[error("data.testbed: {0}")]
    Testbed(#[from] plid_testbed::TestbedError),
    /// The recursion failed.
    #[error(transparent)]
    Identify(IdentifyError),
    /// A model file is wrong, or a model cannot do what is asked.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Model(#[from] ModelError),
    /// Runs cannot be merged.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Merge(#[from] crate::merge::MergeError),
    /// A refinement that was interrupted.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Refine(#[from] plid_refine::RefineError),
    /// A spectrum or test cannot be formed.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Signal(#[from] SignalError),
    /// The user asked for an end.
    #[error("interrupted; `--resume` goes on from {}", checkpoint.display())]
    Interrupted {
        /// The checkpoint.
        checkpoint: PathBuf,
    },
    /// A file cannot be written or read.
    #[error("{}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A checkpoint is of another experiment, or broken.
    #[error("{}: {reason}", path.display())]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// Why it cannot be used.
        reason: String,
    },
}

/// A wrong value of `key`.
pub(super) fn setting(key: &'static str, reason: impl std::fmt::Display) -> RunError {
    RunError::Setting { key, reason: reason.to_string() }
}
