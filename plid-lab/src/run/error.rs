//! The errors of a run.

use std::path::PathBuf;

use crate::experiment::ConfigError;
use crate::identify::IdentifyError;
use plid_data::DataError;
use plid_data::prepare::PrepareError;
use plid_model::ModelError;
use plid_model::signal::SignalError;

/// The reasons why a run does not complete.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
pub enum RunError {
    /// The experiment file is invalid.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Config(#[from] ConfigError),
    /// A value of the experiment is invalid or does not fit the data.
    #[error("{key}: {reason}")]
    Setting {
        /// The key.
        key: &'static str,
        /// The problem with the value.
        reason: String,
    },
    /// A data file is invalid.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Data(#[from] DataError),
    /// The data cannot be prepared as requested.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Prepare(#[from] PrepareError),
    /// The simulated truss rejected its config.
    #[error("data.testbed: {0}")]
    Testbed(#[from] plid_testbed::TestbedError),
    /// The recursion failed.
    #[error(transparent)]
    Identify(IdentifyError),
    /// A model file is invalid, or a model does not permit the calculation.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Model(#[from] ModelError),
    /// The runs cannot be merged.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Merge(#[from] crate::merge::MergeError),
    /// The refinement failed or was interrupted.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Refine(#[from] plid_refine::RefineError),
    /// A spectrum or residual test cannot be computed.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Signal(#[from] SignalError),
    /// The user interrupted the run.
    #[error("interrupted; `--resume` continues from {}", checkpoint.display())]
    Interrupted {
        /// The checkpoint file.
        checkpoint: PathBuf,
    },
    /// The folder of a sweep cannot be used.
    #[error("{}: {reason}", path.display())]
    Sweep {
        /// The file or folder.
        path: PathBuf,
        /// The reason why it cannot be used.
        reason: String,
    },
    /// A file cannot be read or written.
    #[error("{}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The reason that the operating system gives.
        source: std::io::Error,
    },
    /// A result is not a finite number.
    #[error("{}: {source}; nothing is written", path.display())]
    NotFinite {
        /// The file that would hold it.
        path: PathBuf,
        /// The number and its key.
        source: plid_file::NotFinite,
    },
    /// A checkpoint is invalid or belongs to another experiment.
    #[error("{}: {reason}", path.display())]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// The reason why it cannot be used.
        reason: String,
    },
}

/// Returns the error for an invalid value of `key`.
pub(super) fn setting(key: &'static str, reason: impl std::fmt::Display) -> RunError {
    RunError::Setting { key, reason: reason.to_string() }
}
