use plid_model::ModelError;

/// Why there is no estimate. Records and channels count from 0.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
pub enum RefineError {
    /// There is nothing to learn from.
    #[error("no record to learn from")]
    #[diagnostic(code(plid::refine::no_records))]
    NoRecords,
    /// A record does not fit the others or the model.
    #[error("record {record}: {what} has {found} {unit} where {expected} were expected")]
    #[diagnostic(code(plid::refine::shape))]
    Shape {
        /// The record.
        record: usize,
        /// Which array.
        what: &'static str,
        /// Rows or columns.
        unit: &'static str,
        /// The number wanted.
        expected: usize,
        /// The number found.
        found: usize,
    },
    /// An input that is not finite, or an output that is infinite (NaN among the outputs is a missing sample).
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
    /// A channel that is zero throughout, or never there.
    #[error("{what}, channel {channel} is zero or missing throughout")]
    #[diagnostic(code(plid::refine::empty_channel))]
    EmptyChannel {
        /// `the input` or `the output`.
        what: &'static str,
        /// The column.
        channel: usize,
    },
    /// Fewer samples than the estimate needs.
    #[error("{purpose} needs at least {needed} {unit}, the records have {available}")]
    #[diagnostic(
        code(plid::refine::too_little_data),
        help("take fewer states or a longer record; a stretch between missing samples counts by itself")
    )]
    TooLittleData {
        /// What was asked for.
        purpose: &'static str,
        /// What is counted.
        unit: &'static str,
        /// The least number that will do.
        needed: usize,
        /// The number there is.
        available: usize,
    },
    /// A setting that makes no sense.
    #[error("`{setting}` is {value}; it should be {expected}")]
    #[diagnostic(code(plid::refine::setting))]
    Setting {
        /// Its name.
        setting: &'static str,
        /// Its value.
        value: f64,
        /// What it may be.
        expected: &'static str,
    },
    /// A decomposition failed, which the inputs should not bring about.
    #[error("{what} failed")]
    #[diagnostic(code(plid::refine::decomposition))]
    Decomposition {
        /// Which one.
        what: &'static str,
    },
    /// The caller asked for an end.
    #[error("interrupted")]
    #[diagnostic(code(plid::refine::interrupted))]
    Interrupted,
    /// The model cannot be used, or the result is none.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Model(#[from] ModelError),
}
