use std::error::Error;
use std::path::PathBuf;

use plid_data::config::ConfigError;

/// The reasons why a study cannot continue.
#[derive(Debug, thiserror::Error)]
pub enum StudyError {
    /// The config cannot be used.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// A file cannot be read or written.
    #[error("{}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The reason.
        source: std::io::Error,
    },
    /// A result is not a finite number.
    #[error("{}: {source}", path.display())]
    NotFinite {
        /// The file that would hold it.
        path: PathBuf,
        /// The number and its key.
        source: plid_file::NotFinite,
    },
    /// A file written by a study has invalid content.
    #[error("{}, line {line}: {reason}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        /// The fault.
        reason: String,
    },
    /// A cell cannot be measured.
    #[error("{cell}: {source}")]
    Cell {
        /// Its key.
        cell: String,
        /// The reason.
        source: Box<dyn Error + Send + Sync>,
    },
    /// The shards are not complete.
    #[error("{0}")]
    Shards(String),
    /// The user interrupted the study.
    #[error("interrupted; completed cells are in {}, from which --resume continues", journal.display())]
    Interrupted {
        /// The journal.
        journal: PathBuf,
    },
}

impl StudyError {
    /// Creates the error for a cell that could not be measured, with its cause, for `map_err`.
    pub fn cell<E: Error + Send + Sync + 'static>(cell: impl Into<String>) -> impl FnOnce(E) -> Self {
        move |source| Self::Cell { cell: cell.into(), source: Box::new(source) }
    }

    /// Creates the error for a file that would hold a number that is not finite, for `map_err`.
    pub fn not_finite(path: impl Into<PathBuf>) -> impl FnOnce(plid_file::NotFinite) -> Self {
        move |source| Self::NotFinite { path: path.into(), source }
    }

    /// Creates the error for a file that could not be read or written, for `map_err`.
    pub fn file(path: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> Self {
        move |source| Self::File { path: path.into(), source }
    }
}
