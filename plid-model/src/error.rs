use std::path::PathBuf;

/// The fault of one key of a model.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum KeyProblem {
    /// A required key is absent.
    #[error("is missing")]
    Missing,
    /// The value has the wrong JSON type.
    #[error("must be {expected}")]
    Kind {
        /// The type that the key requires, in words.
        expected: &'static str,
    },
    /// A matrix or list has a size that does not agree with the other keys; a list counts as one column.
    #[error("must be {} x {} but is {} x {}", expected.0, expected.1, found.0, found.1)]
    Shape {
        /// Rows and columns required.
        expected: (usize, usize),
        /// Rows and columns found.
        found: (usize, usize),
    },
    /// The value is NaN or infinite.
    #[error("is not finite")]
    NotFinite,
    /// The value is outside its range.
    #[error("is {value}; it must be {expected}")]
    Range {
        /// The value found.
        value: f64,
        /// The permitted range, in words.
        expected: &'static str,
    },
    /// Two channels share a name.
    #[error("names `{name}` twice")]
    Duplicate {
        /// The name.
        name: String,
    },
    /// The name is not that of a channel of the model.
    #[error("names `{name}`, which is not a channel of the model")]
    UnknownChannel {
        /// The name.
        name: String,
    },
    /// A controller drives a channel that is not an input of its plant.
    #[error("names `{name}`, which is not an input of the plant")]
    NoInput {
        /// The name.
        name: String,
    },
}

/// The reasons why a model cannot be read, written or used.
#[derive(Debug, thiserror::Error)]
#[cfg_attr(feature = "diagnostics", derive(miette::Diagnostic))]
pub enum ModelError {
    /// The file could not be read or written.
    #[error("{}: {source}", file.display())]
    Io {
        /// The file.
        file: PathBuf,
        /// The reason that the operating system gives.
        source: std::io::Error,
    },
    /// The file is not valid JSON.
    #[error("{place}:{line}:{column}: {message}")]
    Syntax {
        /// The file.
        place: String,
        /// Line, from 1.
        line: usize,
        /// Column, from 1.
        column: usize,
        /// The message of the JSON parser.
        message: String,
    },
    /// A key of the model is missing or has an invalid value.
    #[error("{place}: key `{key}` {problem}")]
    Key {
        /// The file, or the name of the model.
        place: String,
        /// The key, with indices if a single element is invalid, such as `A[3][2]`.
        key: String,
        /// The problem with the key.
        problem: KeyProblem,
    },
    /// The model lacks a key that this calculation needs.
    #[error("the model has no `{key}`, which is required for {purpose}")]
    Needs {
        /// The key.
        key: &'static str,
        /// The calculation that was requested.
        purpose: &'static str,
    },
    /// The model is not in observable canonical form, so its parameter covariance has no meaning.
    #[error("the model is not in observable canonical form: `{key}` does not have the structure of its indices")]
    NotCanonical {
        /// `A` or `C`.
        key: &'static str,
    },
    /// An array does not have the size that the model requires.
    #[error("{what} must be {} x {} but is {} x {}", expected.0, expected.1, found.0, found.1)]
    Shape {
        /// The name of the array.
        what: &'static str,
        /// Rows and columns required.
        expected: (usize, usize),
        /// Rows and columns found.
        found: (usize, usize),
    },
    /// A value that must be finite is NaN or infinite.
    #[error("{channel} is not finite at sample {sample}")]
    NotFinite {
        /// The channel.
        channel: String,
        /// The sample, from 0.
        sample: usize,
    },
    /// A simulation or prediction exceeded the bound on the outputs.
    #[error("output `{output}` diverged at sample {sample} (magnitude above {bound:e})")]
    Diverged {
        /// The output.
        output: String,
        /// The first sample beyond the bound, from 0.
        sample: usize,
        /// The bound on an output's magnitude.
        bound: f64,
    },
    /// A matrix given as a covariance is not symmetric and positive semidefinite.
    #[error("{what} is not a covariance (symmetric, positive semidefinite)")]
    NotCovariance {
        /// The name of the matrix.
        what: &'static str,
    },
    /// The Riccati equation has no stabilising solution, or the solver did not find it.
    #[error(
        "no stabilising solution of the Riccati equation: relative residual {residual:.1e}, spectral radius of A - K C \
             {radius:.6}, after {iterations} doublings"
    )]
    Riccati {
        /// The residual relative to the solution, both as Frobenius norms.
        residual: f64,
        /// The spectral radius of A - K C.
        radius: f64,
        /// The number of doubling steps taken.
        iterations: usize,
    },
    /// The eigenvalue iteration did not converge.
    #[error("the eigenvalues of A could not be computed")]
    Eigenvalues,
    /// A frequency is outside the range from zero to the Nyquist frequency.
    #[error("the frequency {hz} Hz is outside the range from 0 to {nyquist} Hz")]
    Frequency {
        /// The frequency requested, in Hz.
        hz: f64,
        /// Half the sample rate, in Hz.
        nyquist: f64,
    },
    /// A record lacks a channel of the model.
    #[error("record `{record}` has no channel `{channel}` (model `{model}`); its channels are {present}")]
    UnknownChannel {
        /// The record.
        record: String,
        /// The model.
        model: String,
        /// The channel.
        channel: String,
        /// The channels of the record, separated by commas.
        present: String,
    },
    /// A record and a model have different sample rates.
    #[error("record `{record}` is sampled at {record_hz} Hz, model `{model}` at {model_hz} Hz")]
    Rate {
        /// The record.
        record: String,
        /// Its sample rate in Hz.
        record_hz: f64,
        /// The model.
        model: String,
        /// Its sample rate in Hz.
        model_hz: f64,
    },
    /// A plant and its controller have different sample rates.
    #[error("the controller is sampled at {controller_hz} Hz, the plant at {plant_hz} Hz")]
    LoopRates {
        /// The plant's sample rate in Hz.
        plant_hz: f64,
        /// The controller's sample rate in Hz.
        controller_hz: f64,
    },
    /// Plant and controller both respond within the same sample, and their equations have no unique solution.
    #[error(
        "the feedthrough of the plant and that of the controller form an algebraic loop without a unique solution: the \
             singular values of I - D Dc have the ratio {ratio:.1e}"
    )]
    AlgebraicLoop {
        /// The smallest singular value of I - D Dc over the largest.
        ratio: f64,
    },
    /// The record ends before the first sample that is scored.
    #[error("record `{record}` has {samples} samples; scoring starts at sample {from}")]
    TooShort {
        /// The record.
        record: String,
        /// The number of samples of the record.
        samples: usize,
        /// The first sample that is scored.
        from: usize,
    },
    /// A scale is zero, negative or not finite.
    #[error("the scale of `{channel}` is {value}; it must be positive and finite")]
    Scale {
        /// The channel.
        channel: String,
        /// Its scale.
        value: f64,
    },
}

/// Returns [`ModelError::Shape`] if an array does not have the size that the model requires.
pub(super) fn expect_shape(
    what: &'static str,
    expected: (usize, usize),
    found: (usize, usize),
) -> Result<(), ModelError> {
    if expected == found {
        return Ok(());
    }
    Err(ModelError::Shape { what, expected, found })
}
