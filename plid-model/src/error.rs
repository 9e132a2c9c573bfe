use std::path::PathBuf;

/// What is wrong with one key of a model.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum KeyProblem {
    /// The key must be there.
    #[error("is missing")]
    Missing,
    /// The value is of another kind than the key wants.
    #[error("should be {expected}")]
    Kind {
        /// What the key wants, in words.
        expected: &'static str,
    },
    /// A matrix or list of another size than the other keys imply (a list is one column).
    #[error("should be {} x {}, is {} x {}", expected.0, expected.1, found.0, found.1)]
    Shape {
        /// Rows and columns wanted.
        expected: (usize, usize),
        /// Rows and columns found.
        found: (usize, usize),
    },
    /// NaN or infinity.
    #[error("is not finite")]
    NotFinite,
    /// The value is outside its range.
    #[error("is {value}; it should be {expected}")]
    Range {
        /// The value found.
        value: f64,
        /// The range, in words.
        expected: &'static str,
    },
    /// Two channels have one name.
    #[error("names `{name}` twice")]
    Duplicate {
        /// The name.
        name: String,
    },
    /// A name that no channel has.
    #[error("names `{name}`, which is not a channel of the model")]
    UnknownChannel {
        /// The name.
        name: String,
    },
}

/// Why a model could not be read, written or used.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
pub enum ModelError {
    /// The file could not be read or written.
    #[error("{}: {source}", file.display())]
    Io {
        /// The file.
        file: PathBuf,
        /// The operating system's reason.
        source: std::io::Error,
    },
    /// The file is not JSON.
    #[error("{place}:{line}:{column}: {message}")]
    Syntax {
        /// The file.
        place: String,
        /// Line, from 1.
        line: usize,
        /// Column, from 1.
        column: usize,
        /// What the JSON reader says.
        message: String,
    },
    /// A key of the model is missing or wrong.
    #[error("{place}: key `{key}` {problem}")]
    Key {
        /// The file, or what the model is called.
        place: String,
        /// The key, with indices where one element is at fault (`A[3][2]`).
        key: String,
        /// What is wrong.
        problem: KeyProblem,
    },
    /// The model lacks a key that this calculation needs.
    #[error("the model has no `{key}`, which {purpose} needs")]
    Needs {
        /// The key.
        key: &'static str,
        /// What was asked for.
        purpose: &'static str,
    },
    /// The model is not in observable canonical form, so that its parameter covariance has no meaning.
    #[error("the model is not in the observable canonical form of its indices: `{key}` departs from it")]
    NotCanonical {
        /// `A` or `C`.
        key: &'static str,
    },
    /// An array of another size than the model implies.
    #[error("{what} should be {} x {}, is {} x {}", expected.0, expected.1, found.0, found.1)]
    Shape {
        /// The array.
        what: &'static str,
        /// Rows and columns wanted.
        expected: (usize, usize),
        /// Rows and columns found.
        found: (usize, usize),
    },
    /// NaN or infinity where a number is needed.
    #[error("{channel} is not finite at sample {sample}")]
    NotFinite {
        /// The channel.
        channel: String,
        /// The sample, from 0.
        sample: usize,
    },
    /// A free run or a prediction left all bounds.
    #[error("output `{output}` diverged at sample {sample} (beyond {bound:e})")]
    Diverged {
        /// The output.
        output: String,
        /// The sample, from 0.
        sample: usize,
        /// The bound on an output's magnitude.
        bound: f64,
    },
    /// A covariance is not symmetric and positive semidefinite.
    #[error("{what} is not a covariance (symmetric, positive semidefinite)")]
    NotCovariance {
        /// Which covariance.
        what: &'static str,
    },
    /// The Riccati equation was not solved.
    #[error(
        "no stabilising solution of the Riccati equation: relative residual {residual:.1e}, spectral radius of A - K C {radius:.6}, after {iterations} doublings"
    )]
    Riccati {
        /// Residual over the solution, both as Frobenius norms.
        residual: f64,
        /// Spectral radius of A - K C.
        radius: f64,
        /// Doubling steps taken.
        iterations: usize,
    },
    /// The eigenvalue iteration did not converge.
    #[error("the eigenvalues of A were not found")]
    Eigenvalues,
    /// A frequency that the model cannot be asked about.
    #[error("the frequency {hz} Hz is outside 0 to {nyquist} Hz")]
    Frequency {
        /// The frequency asked for.
        hz: f64,
        /// Half the sample rate.
        nyquist: f64,
    },
    /// A record lacks a channel of the model.
    #[error("record `{record}` has no channel `{channel}` (model `{model}`); it has {present}")]
    UnknownChannel {
        /// The record.
        record: String,
        /// The model.
        model: String,
        /// The channel.
        channel: String,
        /// The channels that are there.
        present: String,
    },
    /// A record and a model have different sample rates.
    #[error("record `{record}` is at {record_hz} Hz, model `{model}` at {model_hz} Hz")]
    Rate {
        /// The record.
        record: String,
        /// Its rate.
        record_hz: f64,
        /// The model.
        model: String,
        /// Its rate.
        model_hz: f64,
    },
    /// There is nothing to score.
    #[error("record `{record}` has {samples} samples; scoring starts at sample {from}")]
    TooShort {
        /// The record.
        record: String,
        /// Its samples.
        samples: usize,
        /// The first sample that counts.
        from: usize,
    },
    /// A scale that is zero, negative or not finite.
    #[error("the scale of `{channel}` is {value}; it should be positive and finite")]
    Scale {
        /// The channel.
        channel: String,
        /// Its scale.
        value: f64,
    },
}

/// An error if an array has another size than the model implies.
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
