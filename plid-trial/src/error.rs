use std::path::PathBuf;

use miette::Diagnostic;
use plid_data::DataError;
use plid_data::config::ConfigError;
use plid_model::ModelError;

use crate::program::Program;

/// A trial that cannot continue.
#[derive(Debug, thiserror::Error, Diagnostic)]
pub enum TrialError {
    /// TRIAL.toml cannot be used.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Config(#[from] ConfigError),
    /// A case cannot be drawn.
    #[error("{what}: {reason}")]
    Draw {
        /// The effects that were asked for.
        what: String,
        /// The reason.
        reason: String,
    },
    /// A held-out record cannot be read.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Data(#[from] DataError),
    /// A model cannot be read or simulated.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A file cannot be read or written.
    #[error("{}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The cause.
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
    /// A file of a trial with invalid content.
    #[error("{}: {reason}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// A sealed file does not match the hash that the trial committed to.
    #[error("{case}: {} is not the sealed file: its hash differs from the trial's commitment", path.display())]
    Broken {
        /// The case.
        case: String,
        /// The sealed file.
        path: PathBuf,
    },
    /// A case is not the one that was drawn.
    #[error("{case}: {} is not the file that was drawn; the case is rejected", path.display())]
    Altered {
        /// The case.
        case: String,
        /// The file that has changed, is missing or was added.
        path: PathBuf,
    },
    /// Answers of different programs cannot be scored together.
    #[error(
        "{what} comes from {theirs}, but {} {ours}; answer all cases with one program, in a separate folder",
        if *running { "this is" } else { "another comes from" }
    )]
    OtherProgram {
        /// The answer or shard.
        what: String,
        /// The program from which it comes.
        theirs: Box<Program>,
        /// The program of the other answers or shards.
        ours: Box<Program>,
        /// Whether `ours` is the running program.
        running: bool,
    },
    /// An answer is not the one that was given.
    #[error("{case}: the answer has changed since {since}; it is rejected")]
    Changed {
        /// The case.
        case: String,
        /// The event since which it has changed.
        since: &'static str,
    },
    /// Cases without an answer.
    #[error(
        "{missing} of {all} cases have no answer yet, {first} is the first; finish `diagnose`, and `merge` where it \
         ran in shards; or `score --answered`"
    )]
    Unanswered {
        /// Number of cases without an answer.
        missing: usize,
        /// Number of all cases.
        all: usize,
        /// The first case without an answer.
        first: String,
    },
    /// The shards are incomplete or overlap.
    #[error("{0}")]
    Shards(String),
    /// The user interrupted the trial.
    #[error("interrupted; finished work is in {}, and the same command continues from it", directory.display())]
    Interrupted {
        /// The answers.
        directory: PathBuf,
    },
}

impl TrialError {
    /// Returns a function for `map_err` that adds the file that could not be read or written.
    pub(crate) fn file(path: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> Self {
        move |source| Self::File { path: path.into(), source }
    }
}
