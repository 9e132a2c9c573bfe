use ndarray::ArrayView2;

/// The reasons why [`crate::signal`] rejects a record. Fields count channels and samples from 0, and messages from 1.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[cfg_attr(feature = "diagnostics", derive(miette::Diagnostic))]
pub enum SignalError {
    /// The record has fewer samples (or lags, or periods) than the estimate requires.
    #[error("{what} requires at least {needed} {unit}; the record has {available}")]
    TooShort {
        /// The estimate that was requested.
        what: &'static str,
        /// The unit of the count: samples, usable segments or periods.
        unit: &'static str,
        /// The smallest sufficient number.
        needed: usize,
        /// The number available.
        available: usize,
    },
    /// Two related records have different numbers of rows.
    #[error("{what} has {found} samples where {expected} were expected")]
    LengthMismatch {
        /// The record with the wrong length.
        what: &'static str,
        /// Rows of the other record.
        expected: usize,
        /// Rows found.
        found: usize,
    },
    /// Two related records have different numbers of channels.
    #[error("{what} has {found} channels where {expected} were expected")]
    ChannelMismatch {
        /// The record with the wrong number of channels.
        what: &'static str,
        /// Channels expected.
        expected: usize,
        /// Channels found.
        found: usize,
    },
    /// A record has no channels.
    #[error("{what} has no channels")]
    NoChannels {
        /// The record.
        what: &'static str,
    },
    /// A sample is infinite; only NaN marks a missing sample.
    #[error("{what}, channel {}, sample {} is infinite", .channel + 1, .sample + 1)]
    Infinite {
        /// The record.
        what: &'static str,
        /// Its column.
        channel: usize,
        /// Its row.
        sample: usize,
    },
    /// A channel is constant or has no samples, so it carries no information.
    #[error("{what}, channel {} is constant or has no samples", .channel + 1)]
    Constant {
        /// The record.
        what: &'static str,
        /// Its column.
        channel: usize,
    },
    /// A setting is out of range.
    #[error("{name} = {value} is out of range: {allowed}")]
    Setting {
        /// The setting's name.
        name: &'static str,
        /// The value of the setting.
        value: f64,
        /// The permitted range, in words.
        allowed: &'static str,
    },
    /// No spectral line of a periodic record can be resolved.
    #[error(
        "every excited line has more than {records} active inputs; supply one record for each input that is active at \
             the same time"
    )]
    NoResolvableLine {
        /// Number of records supplied.
        records: usize,
    },
}

/// Rejects a record that has no channels or contains an infinite sample.
pub(super) fn check_record(what: &'static str, data: ArrayView2<f64>) -> Result<(), SignalError> {
    if data.ncols() == 0 {
        return Err(SignalError::NoChannels { what });
    }
    match data.indexed_iter().find(|(_, value)| value.is_infinite()) {
        Some(((sample, channel), _)) => Err(SignalError::Infinite { what, channel, sample }),
        None => Ok(()),
    }
}

/// Rejects a record whose number of rows differs from `expected`.
pub(super) fn check_rows(what: &'static str, data: ArrayView2<f64>, expected: usize) -> Result<(), SignalError> {
    if data.nrows() == expected {
        return Ok(());
    }
    Err(SignalError::LengthMismatch { what, expected, found: data.nrows() })
}

/// Rejects a number that is not finite and positive.
pub(super) fn check_positive(name: &'static str, value: f64) -> Result<(), SignalError> {
    if value.is_finite() && value > 0.0 {
        return Ok(());
    }
    Err(SignalError::Setting { name, value, allowed: "a finite positive number" })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_count_from_one() {
        let error = SignalError::Infinite { what: "the residual", channel: 0, sample: 9 };
        assert_eq!(error.to_string(), "the residual, channel 1, sample 10 is infinite");
    }
}
