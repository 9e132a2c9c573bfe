//! The reasons why data cannot be prepared as requested.

/// A preparation that is not possible with these data.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
pub enum PrepareError {
    /// The records are incompatible or contain no information.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Data(#[from] crate::DataError),
    /// There is nothing to prepare.
    #[error("there is no record to prepare")]
    NoRecords,
    /// The shares of training data do not fit the records.
    #[error("training shares {shares:?} do not fit {records} records: one share from 0 to 1 for each, not all 0")]
    TrainingShares {
        /// The shares as given.
        shares: Vec<f64>,
        /// Number of records.
        records: usize,
    },
    /// The rate to decimate to is impossible or above that of the data.
    #[error("cannot decimate from {from_hz} Hz to {to_hz} Hz")]
    DecimationRate {
        /// Rate of the data in Hz.
        from_hz: f64,
        /// Requested rate in Hz.
        to_hz: f64,
    },
    /// The rate to decimate to is not an integer fraction of the rate of the data.
    #[error("{to_hz} Hz is not {from_hz} Hz divided by an integer; the nearest are {below_hz} and {above_hz} Hz")]
    DecimationRatio {
        /// Rate of the data in Hz.
        from_hz: f64,
        /// Requested rate in Hz.
        to_hz: f64,
        /// Nearest possible rate below.
        below_hz: f64,
        /// Nearest possible rate above.
        above_hz: f64,
    },
    /// A record is too short for a step.
    #[error("record {record} has {samples} samples; {step} needs at least {needed}")]
    TooShort {
        /// Number of the record, from 1.
        record: usize,
        /// Number of its samples.
        samples: usize,
        /// Name of the step.
        step: &'static str,
        /// Smallest number of samples that the step needs.
        needed: usize,
    },
    /// There are fewer than two repeats.
    #[error("averaging needs at least two repeats; there are {found}")]
    TooFewRepeats {
        /// Number of repeats found.
        found: usize,
    },
    /// Repeats of different lengths.
    #[error("repeat {repeat} has {samples} samples where {expected} are expected")]
    RepeatLength {
        /// Number of the repeat, from 1.
        repeat: usize,
        /// Number of its samples.
        samples: usize,
        /// Number of samples of the first repeat.
        expected: usize,
    },
    /// The input of a repeat differs from that of the others.
    #[error(
        "input `{channel}` does not repeat: repeat {repeat} differs from the mean by {difference:.2e} of its RMS, \
         {tolerance:.2e} is allowed"
    )]
    NotRepeated {
        /// The input.
        channel: String,
        /// Number of the repeat, from 1.
        repeat: usize,
        /// RMS of the difference over RMS of the mean.
        difference: f64,
        /// The limit.
        tolerance: f64,
    },
    /// A record that should have no input has one.
    #[error("input `{channel}` has an RMS of {rms:.3e}, where at most {limit:.3e} counts as zero")]
    InputNotZero {
        /// The input.
        channel: String,
        /// RMS about its mean, in its units.
        rms: f64,
        /// The limit.
        limit: f64,
    },
    /// A step that needs the whole record was requested for a record that is read in blocks.
    #[error("a record that is read in blocks cannot be prepared with `{step}`")]
    NotInBlocks {
        /// The key of the step.
        step: &'static str,
    },
    /// There are too few complete samples for a covariance of the noise.
    #[error("{samples} complete samples are too few for the noise covariance of {outputs} outputs")]
    TooFewForNoise {
        /// Number of samples without a missing value.
        samples: usize,
        /// Number of outputs.
        outputs: usize,
    },
}
