use plid_model::ModelError;

/// The reasons why an estimate cannot be computed. Records and channels are counted from 0.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
pub enum RefineError {
    /// The list of records is empty.
    #[error("no training record was given")]
    #[diagnostic(code(plid::refine::no_records))]
    NoRecords,
    /// A record does not agree with the other records or with the model.
    #[error("record {record}: {what} has {found} {unit} where {expected} were expected")]
    #[diagnostic(code(plid::refine::shape))]
    Shape {
        /// The record.
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
    #[error("record {record}: {what}, channel {channel}, sample {sample} is not finite")]
    #[diagnostic(code(plid::refine::not_finite))]
    NotFinite {
        /// The record.
        record: usize,
        /// `the input` or `the output`.
        what: &'static str,
        /// The column.
        channel: usize,
        /// The row.
        sample: usize,
    },
    /// A channel is zero or missing throughout.
    #[error("{what}, channel {channel} is zero or missing throughout")]
    #[diagnostic(code(plid::refine::empty_channel))]
    EmptyChannel {
        /// `the input` or `the output`.
        what: &'static str,
        /// The column.
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
    /// The caller requested an end through its [`crate::Watcher`].
    #[error("interrupted")]
    #[diagnostic(code(plid::refine::interrupted))]
    Interrupted,
    /// The model is invalid or cannot be used.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Model(#[from] ModelError),
}
