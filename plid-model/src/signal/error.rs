use ndarray::ArrayView2;

/// What can be wrong with a record handed to [`crate::signal`]. Channels and records count from 0.
#[derive(Debug, Clone, PartialEq, thiserror::Error, miette::Diagnostic)]
pub enum SignalError {
    /// Fewer samples (or lags, or periods) than the estimate needs.
    #[error("{what} needs at least {needed} {unit}, the record has {available}")]
    TooShort {
        /// The estimate that was asked for.
        what: &'static str,
        /// What is counted: samples, usable segments, periods.
        unit: &'static str,
        /// The least number that will do.
        needed: usize,
        /// The number there is.
        available: usize,
    },
    /// Two records that belong together differ in their number of rows.
    #[error("{what} has {found} samples where {expected} were expected")]
    LengthMismatch {
        /// The record with the wrong length.
        what: &'static str,
        /// Rows of the record it goes with.
        expected: usize,
        /// Rows found.
        found: usize,
    },
    /// Two records that belong together differ in their number of channels.
    #[error("{what} has {found} channels where {expected} were expected")]
    ChannelMismatch {
        /// The record with the wrong number of channels.
        what: &'static str,
        /// Channels expected.
        expected: usize,
        /// Channels found.
        found: usize,
    },
    /// A record without channels.
    #[error("{what} has no channels")]
    NoChannels {
        /// The record.
        what: &'static str,
    },
    /// A sample is plus or minus infinity; a missing sample is marked by NaN.
    #[error("{what}, channel {channel}, sample {sample} is infinite")]
    Infinite {
        /// The record.
        what: &'static str,
        /// Its column.
        channel: usize,
        /// Its row.
        sample: usize,
    },
    /// A channel that never changes (or has no sample at all) carries no information.
    #[error("{what}, channel {channel} is constant or has no samples")]
    Constant {
        /// The record.
        what: &'static str,
        /// Its column.
        channel: usize,
    },
    /// A setting outside its range.
    #[error("{name} = {value} is out of range: {allowed}")]
    Setting {
        /// The setting's name.
        name: &'static str,
        /// The value given.
        value: f64,
        /// What is allowed, in words.
        allowed: &'static str,
    },
    /// No line of a periodic record can be resolved.
    #[error(
        "no spectral line is excited by at most {records} inputs at once; give one record for each input that acts at the same time"
    )]
    NoResolvableLine {
        /// Number of records given.
        records: usize,
    },
}

/// Refuses a record without channels and one with an infinite sample.
pub(super) fn check_record(what: &'static str, data: ArrayView2<f64>) -> Result<(), SignalError> {
    if data.ncols() == 0 {
        return Err(SignalError::NoChannels { what });
    }
    match data.indexed_iter().find(|(_, value)| value.is_infinite()) {
        Some(((sample, channel), _)) => Err(SignalError::Infinite { what, channel, sample }),
        None => Ok(()),
    }
}

/// Refuses a record whose number of rows differs from `expected`.
pub(super) fn check_rows(what: &'static str, data: ArrayView2<f64>, expected: usize) -> Result<(), SignalError> {
    if data.nrows() == expected {
        return Ok(());
    }
    Err(SignalError::LengthMismatch { what, expected, found: data.nrows() })
}

/// Refuses a number that is not finite and positive.
pub(super) fn check_positive(name: &'static str, value: f64) -> Result<(), SignalError> {
    if value.is_finite() && value > 0.0 {
        return Ok(());
    }
    Err(SignalError::Setting { name, value, allowed: "a finite positive number" })
}
