use plid_model::ModelError;

/// The reasons why an estimate cannot be computed. Records and channels are counted from 0.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
pub enum RefineError {
    /// The list of records is empty.
    #[error("no training record was given")]
    #[diagnostic(code(plid::refine::no_records))]
    NoRecords,
    /// A record does not agree with the other records or with the model.
    #[error("record {}: {what} has {found} {unit} where {expected} were expected", .record + 1)]
    #[diagnostic(code(plid::refine::shape))]
    Shape {
        /// The record, from 0; the message counts from 1.
        record: usize,
        /// The array: `the input` or `the output`.
        what: &'static str,
        /// The unit of the count: samples or channels.
        unit: &'static str,
        /// The number required.
        expected: usize,
        /// The number found.
        found: usize,
    },
    /// An input is not finite, or an output is infinite; NaN marks a missing output.
    #[error("record {}: {what}, channel {}, sample {} is not finite", .record + 1, .channel + 1, .sample + 1)]
    #[diagnostic(code(plid::refine::not_finite))]
    NotFinite {
        /// The record, from 0; the message counts from 1.
        record: usize,
        /// `the input` or `the output`.
        what: &'static str,
        /// The column, from 0; the message counts from 1.
        channel: usize,
        /// The row, from 0; the message counts from 1.
        sample: usize,
    },
    /// A channel is zero or missing throughout.
    #[error("{what}, channel {} is zero or missing throughout", .channel + 1)]
    #[diagnostic(code(plid::refine::empty_channel))]
    EmptyChannel {
        /// `the input` or `the output`.
        what: &'static str,
        /// The column, from 0; the message counts from 1.
        channel: usize,
    },
    /// The records have fewer samples than the estimate requires.
    #[error("{purpose} requires at least {needed} {unit}; the records have {available}")]
    #[diagnostic(
        code(plid::refine::too_little_data),
        help("use fewer states or a longer record; missing samples divide a record into separate segments")
    )]
    TooLittleData {
        /// The estimate that was requested.
        purpose: &'static str,
        /// The unit of the count.
        unit: &'static str,
        /// The smallest sufficient number.
        needed: usize,
        /// The number available.
        available: usize,
    },
    /// A setting is out of range.
    #[error("`{setting}` is {value}; it must be {expected}")]
    #[diagnostic(code(plid::refine::setting))]
    Setting {
        /// Its name.
        setting: &'static str,
        /// Its value.
        value: f64,
        /// The permitted range, in words.
        expected: &'static str,
    },
    /// A matrix decomposition failed, which valid records should not cause.
    #[error("{what} failed")]
    #[diagnostic(code(plid::refine::decomposition))]
    Decomposition {
        /// The decomposition or fit that failed.
        what: &'static str,
    },
    /// The caller requested a stop through its [`crate::Watcher`].
    #[error("interrupted")]
    #[diagnostic(code(plid::refine::interrupted))]
    Interrupted,
    /// The model is invalid or cannot be used.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Model(#[from] ModelError),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_count_from_one() {
        let error = RefineError::NotFinite { record: 0, what: "the input", channel: 1, sample: 4 };
        assert_eq!(error.to_string(), "record 1: the input, channel 2, sample 5 is not finite");
        let error = RefineError::EmptyChannel { what: "the output", channel: 0 };
        assert_eq!(error.to_string(), "the output, channel 1 is zero or missing throughout");
    }
}
