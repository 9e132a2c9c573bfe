//! Errors of a diagnosis.

use std::path::PathBuf;

use miette::Diagnostic;
use plid_data::DataError;
use plid_data::config::ConfigError;
use plid_model::ModelError;

/// A diagnosis that is not possible.
#[derive(Debug, thiserror::Error, Diagnostic)]
pub enum GapError {
    /// The case file is invalid.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Case(#[from] ConfigError),
    /// A record is invalid.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Data(#[from] DataError),
    /// The simulation's model is invalid.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A key of the case does not fit the other keys, the records or the simulation.
    #[error("{}: {key}: {message}", file.display())]
    Key {
        /// The case file.
        file: PathBuf,
        /// The key.
        key: String,
        /// What is wrong.
        message: String,
    },
    /// A name in `suspects` or `exclude` is neither an effect nor a location.
    #[error("`{key}` names `{name}`, which is neither an effect nor a location of this case{}",
        suggestion.as_ref().map(|name| format!("; did you mean `{name}`?")).unwrap_or_default())]
    Name {
        /// The key of the case.
        key: &'static str,
        /// The name as written.
        name: String,
        /// The most similar name.
        suggestion: Option<String>,
    },
    /// A force cannot act at a port that the case declares.
    #[error("[[port]] `{name}`: {message}")]
    Port {
        /// The name of the port.
        name: String,
        /// The reason.
        message: String,
    },
    /// The engineer's own simulator failed.
    #[error(transparent)]
    Simulator(#[from] plid_simulator::SimulatorError),
    /// The simulation is unstable.
    #[error("{}: the simulation is unstable: a pole of magnitude {magnitude:.6} at {hz:.2} Hz", file.display())]
    #[diagnostic(help(
        "its free run diverges; declare the controller that stabilised the records under `[controller]`, or omit \
        `sim`, so that a model is identified from the records"
    ))]
    Unstable {
        /// The simulation's file.
        file: PathBuf,
        /// Magnitude of its largest pole.
        magnitude: f64,
        /// Frequency of that pole.
        hz: f64,
    },
    /// The loop of the simulation and the controller is unstable.
    #[error(
        "{}: the loop that it closes around the simulation is unstable: a pole of magnitude {magnitude:.6} at {hz:.2} \
        Hz",
        file.display()
    )]
    #[diagnostic(help(
        "the records are stable, so the controller or the simulation differs from the real one: check the signs and \
        the units of the controller's channels, and whether it subtracts the outputs that it reads"
    ))]
    UnstableLoop {
        /// The controller's file.
        file: PathBuf,
        /// Magnitude of the largest pole of the closed loop.
        magnitude: f64,
        /// Frequency of that pole.
        hz: f64,
    },
    /// A channel is constant in all records.
    #[error("channel `{channel}` is constant in every record")]
    Constant {
        /// The channel.
        channel: String,
    },
    /// A record does not fit the case or the simulation, or contains values that are not measurements.
    #[error("{record}: {message}")]
    Record {
        /// The record.
        record: String,
        /// What is wrong.
        message: String,
    },
    /// A prediction diverges.
    #[error(
        "output `{output}` diverges at sample {sample} (from 0): it is {value:.3e}, where a peak of about \
        {expected:.3e} is expected"
    )]
    #[diagnostic(help(
        "the input exceeds the range in which the effect's law holds, or the effect itself is unstable there"
    ))]
    Diverged {
        /// The output.
        output: String,
        /// The sample, from 0.
        sample: usize,
        /// The output at that sample.
        value: f64,
        /// The peak that was expected. For a linear simulation: its own peak, or that of the fitted records if this
        /// is larger. For a simulator in the loop: that of the fitted records, in proportion to a louder input, or
        /// that of a run without the effects if the file does not state it.
        expected: f64,
    },
    /// The records are too short for a fit.
    #[error("{0}")]
    TooLittle(String),
    /// A file cannot be read or written.
    #[error("{}: {source}", file.display())]
    Io {
        /// The file.
        file: PathBuf,
        /// The cause.
        source: std::io::Error,
    },
    /// A result is not a finite number, so no file is written.
    #[error("{}: {source}", file.display())]
    #[diagnostic(help("a value of the records or of the simulation may be too large to square"))]
    NotFinite {
        /// The file that was to be written.
        file: PathBuf,
        /// The key and its value.
        source: plid_model::NotFinite,
    },
    /// A file of this program is malformed.
    #[error("{}: {message}", file.display())]
    Malformed {
        /// The file.
        file: PathBuf,
        /// What is wrong.
        message: String,
    },
    /// A step failed unexpectedly: the model cannot be fitted.
    #[error("{0}")]
    Failed(String),
}
