//! Errors in data, with file, line, column and channel.
use std::path::PathBuf;

/// The reasons why data cannot be used.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
pub enum DataError {
    /// The file cannot be opened or read.
    #[error("{file}: cannot be read: {source}")]
    Io {
        /// The file.
        file: PathBuf,
        /// The error of the operating system.
        source: std::io::Error,
    },
    /// The file contains nothing but blanks and comments.
    #[error("{file}: the file is empty")]
    Empty {
        /// The file.
        file: PathBuf,
    },
    /// The file has a header but no samples.
    #[error("{file}: there is a header but no sample below it")]
    NoSamples {
        /// The file.
        file: PathBuf,
    },
    /// The file has a single sample, which contains no information about a dynamic system.
    #[error("{file}: there is only one sample")]
    OneSample {
        /// The file.
        file: PathBuf,
    },
    /// A row with too few or too many cells.
    #[error("{file}, line {line}: {found} cells where {expected} are expected")]
    #[diagnostic(help("every row must have as many cells as the first row of the file"))]
    Ragged {
        /// The file.
        file: PathBuf,
        /// Line in the file, from 1.
        line: usize,
        /// Cells of the header or of the first row.
        expected: usize,
        /// Cells of this row.
        found: usize,
    },
    /// A cell that is not a number.
    #[error("{file}, line {line}, column `{column}`: `{cell}` is not a number")]
    #[diagnostic(help("a missing value is an empty cell or NaN; comments begin with #"))]
    NotANumber {
        /// The file.
        file: PathBuf,
        /// Line in the file, from 1.
        line: usize,
        /// Name of the column.
        column: String,
        /// The content of the cell, at most 40 characters.
        cell: String,
    },
    /// A value far down in a column that otherwise has one in its first row only.
    #[error("{file}, line {line}: column `{column}` has a value again after its first row")]
    #[diagnostic(help(
        "in a file that is read in blocks, a column without values in the first thousand rows is a scalar"
    ))]
    LateValue {
        /// The file.
        file: PathBuf,
        /// Line in the file, from 1.
        line: usize,
        /// Name of the column.
        column: String,
    },
    /// Two columns with the same name.
    #[error("{file}: two columns are named `{name}`")]
    DuplicateColumn {
        /// The file.
        file: PathBuf,
        /// The name.
        name: String,
    },
    /// A file that violates its format.
    #[error("{file}: {what}")]
    Malformed {
        /// The file.
        file: PathBuf,
        /// The fault.
        what: String,
    },
    /// A .mat or .npz file whose variables do not form one table.
    #[error("{file}: several variables of different lengths, choose one of {there}")]
    #[diagnostic(help("rows are samples; name the variable that holds the data"))]
    ChooseVariable {
        /// The file.
        file: PathBuf,
        /// The variables with their sizes.
        there: String,
    },
    /// A variable that is not in the .mat or .npz file.
    #[error("{file}: there is no variable `{variable}`, only {there}{}", did_you_mean(.suggestion))]
    UnknownVariable {
        /// The file.
        file: PathBuf,
        /// The requested variable.
        variable: String,
        /// The variables with their sizes.
        there: String,
        /// The nearest name.
        suggestion: Option<String>,
    },
    /// A channel that is not in the table.
    #[error("{file}: there is no channel `{channel}`, only {}{}", .there.join(", "), did_you_mean(.suggestion))]
    UnknownChannel {
        /// The file.
        file: PathBuf,
        /// The requested channel.
        channel: String,
        /// All channels of the file.
        there: Vec<String>,
        /// The nearest name.
        suggestion: Option<String>,
    },
    /// A channel that is requested twice.
    #[error("the channel `{channel}` is named twice among inputs and outputs")]
    RepeatedChannel {
        /// The channel.
        channel: String,
    },
    /// No input or no output is named.
    #[error("no {side} channel is named")]
    NoChannels {
        /// `input` or `output`.
        side: &'static str,
    },
    /// A sample rate that is zero, negative or not finite.
    #[error("{file}: a sample rate of {rate_hz} Hz ({origin}) is not possible")]
    BadRate {
        /// The file.
        file: PathBuf,
        /// The rate in Hz.
        rate_hz: f64,
        /// The source of the rate.
        origin: String,
    },
    /// A time column whose step is not constant.
    #[error("{file}: the time step of column `{column}` changes at {at}: {step_s} s where {expected_s} s is usual")]
    #[diagnostic(help("samples must be evenly spaced; resample the data, or give the rate"))]
    UnevenTime {
        /// The file.
        file: PathBuf,
        /// Name of the time column.
        column: String,
        /// Line or row of the later sample.
        at: String,
        /// The step there in s.
        step_s: f64,
        /// The median step in s.
        expected_s: f64,
    },
    /// NaN or infinity where the policy does not allow it.
    #[error("{file}: channel `{channel}` is {value:e} at {at}")]
    #[diagnostic(help(
        "missing outputs may be marked by NaN if the missing-data policy is set to `nan`; inputs must be complete, and \
         no magnitude may exceed 1e70"
    ))]
    NotFinite {
        /// The file.
        file: PathBuf,
        /// The channel.
        channel: String,
        /// Line or row.
        at: String,
        /// The value there.
        value: f64,
    },
    /// An output without any value.
    #[error("{file}: output `{channel}` has no value at all")]
    AllMissing {
        /// The file.
        file: PathBuf,
        /// The channel.
        channel: String,
    },
    /// All inputs are constant: nothing excites the plant.
    #[error("{file}: all inputs are constant ({}): nothing can be identified", .channels.join(", "))]
    NoExcitation {
        /// The file.
        file: PathBuf,
        /// The inputs.
        channels: Vec<String>,
    },
    /// All outputs are constant.
    #[error("{file}: all outputs are constant ({}): there is nothing to identify", .channels.join(", "))]
    NoResponse {
        /// The file.
        file: PathBuf,
        /// The outputs.
        channels: Vec<String>,
    },
    /// Fewer equations than unknowns.
    #[error("{samples} samples are too few for {unknowns} unknown parameters")]
    #[diagnostic(help("use fewer states or a longer record"))]
    TooFewSamples {
        /// Samples of an output.
        samples: usize,
        /// Unknown parameters of an output.
        unknowns: usize,
    },
    /// Records that cannot be used together.
    #[error("record {record} differs from record 1: {what}")]
    RecordsDiffer {
        /// Number of the record, from 1.
        record: usize,
        /// The difference.
        what: String,
    },
}

fn did_you_mean(suggestion: &Option<String>) -> String {
    suggestion.as_ref().map(|name| format!("; did you mean `{name}`?")).unwrap_or_default()
}

/// Returns the name nearest to `wanted`, if it is similar enough to be a typing error.
pub fn nearest<'a>(wanted: &str, names: impl IntoIterator<Item = &'a String>) -> Option<String> {
    names
        .into_iter()
        .map(|name| {
            let likeness = strsim::jaro_winkler(&wanted.to_lowercase(), &name.to_lowercase());
            (likeness, name)
        })
        .filter(|(likeness, _)| *likeness > 0.75)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, name)| name.clone())
}
