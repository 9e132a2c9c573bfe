//! What can stop a diagnosis.

use std::path::PathBuf;

use miette::Diagnostic;
use plid_data::DataError;
use plid_data::config::ConfigError;
use plid_model::ModelError;

/// A diagnosis that cannot be made.
#[derive(Debug, thiserror::Error, Diagnostic)]
pub enum GapError {
    /// The case file is wrong.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Case(#[from] ConfigError),
    /// A record is wrong.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Data(#[from] DataError),
    /// The simulation's model is wrong.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// What a key of the case asks for does not fit the rest.
    #[error("{}: {key}: {message}", file.display())]
    Key {
        /// The case.
        file: PathBuf,
        /// Its key.
        key: String,
        /// What is wrong.
        message: String,
    },
    /// A name in `suspects` or `exclude` that is neither an effect nor a place.
    #[error("`{key}` names `{name}`, which is neither an effect nor a place of this case{}",
        suggestion.as_ref().map(|name| format!("; did you mean `{name}`?")).unwrap_or_default())]
    Name {
        /// Of the case.
        key: &'static str,
        /// As written.
        name: String,
        /// What comes nearest.
        suggestion: Option<String>,
    },
    /// The simulation grows without bound.
    #[error("{}: the simulation is unstable: a pole of magnitude {magnitude:.6} at {hz:.2} Hz", file.display())]
    #[diagnostic(help(
        "a free run of it says nothing; stabilise it, or leave `sim` out and let the records give a model"
    ))]
    Unstable {
        /// The simulation.
        file: PathBuf,
        /// Of its largest pole.
        magnitude: f64,
        /// Frequency of that pole.
        hz: f64,
    },
    /// A channel says nothing in any record.
    #[error("channel `{channel}` is constant in every record")]
    Constant {
        /// The channel.
        channel: String,
    },
    /// A record does not fit the case or the simulation, or holds what is no measurement.
    #[error("{record}: {message}")]
    Record {
        /// The record.
        record: String,
        /// What is wrong.
        message: String,
    },
    /// A prediction that leaves all bounds.
    #[error(
        "output `{output}` diverges at sample {sample} (from 0): it is {value:.3e}, where the linear simulation stays within {linear:.3e}"
    )]
    #[diagnostic(help(
        "the input goes beyond what the effect's law holds for, or the effect itself is unstable there"
    ))]
    Diverged {
        /// The output.
        output: String,
        /// From 0.
        sample: usize,
        /// The output there.
        value: f64,
        /// Peak of the linear simulation, or of the fitted records where that is larger.
        linear: f64,
    },
    /// There is not enough to fit from.
    #[error("{0}")]
    TooLittle(String),
    /// A file cannot be read or written.
    #[error("{}: {source}", file.display())]
    Io {
        /// The file.
        file: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A result that is no number where a number belongs: nothing is written then.
    #[error("{}: {source}", file.display())]
    #[diagnostic(help("a value of the records or of the simulation may be too large to square"))]
    NotFinite {
        /// The file that was to be written.
        file: PathBuf,
        /// The key, and what it is.
        source: plid_model::NotFinite,
    },
    /// A file of ours that is not what it should be.
    #[error("{}: {message}", file.display())]
    Malformed {
        /// The file.
        file: PathBuf,
        /// What is wrong.
        message: String,
    },
    /// A step failed that should not: the model cannot be fitted.
    #[error("{0}")]
    Failed(String),
}
