//! Warnings for the reader of a report. They do not stop the calculation.
use serde::{Deserialize, Serialize};

/// A named warning on data or their preparation; `Display` states it in a sentence.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, thiserror::Error)]
#[serde(tag = "warning", rename_all = "kebab-case")]
pub enum Warning {
    /// Neither the config nor the file gives the sample rate.
    #[error("{file} does not state its sample rate: 1 Hz is assumed, so all frequencies are in cycles per sample")]
    RateAssumed {
        /// The file.
        file: String,
    },
    /// A variable of a file that is not a table of real numbers.
    #[error("{file}: variable `{variable}` is {what} and is ignored")]
    UnusedVariable {
        /// The file.
        file: String,
        /// The variable.
        variable: String,
        /// Its kind, such as `a struct`.
        what: String,
    },
    /// An input that never changes.
    #[error("input `{channel}` is constant: nothing can be learnt about its effect")]
    ConstantInput {
        /// The channel.
        channel: String,
    },
    /// An output that never changes.
    #[error("output `{channel}` is constant: is the sensor connected?")]
    ConstantOutput {
        /// The channel.
        channel: String,
    },
    /// An output with samples that are missing (NaN).
    #[error("output `{channel}` lacks {missing} of {samples} samples")]
    MissingSamples {
        /// The channel.
        channel: String,
        /// Samples that are missing.
        missing: usize,
        /// Total number of samples.
        samples: usize,
    },
    /// The anti-alias filter turns one missing sample into many.
    #[error(
        "output `{channel}` of record {record} lacks {missing} samples, and decimation masks all that its filter \
         touches: {masked} of {samples} samples at the new rate"
    )]
    MaskedByFilter {
        /// The channel.
        channel: String,
        /// Number of the record, from 1.
        record: usize,
        /// Missing samples before decimation.
        missing: usize,
        /// Missing samples after decimation.
        masked: usize,
        /// Total number of samples after decimation.
        samples: usize,
    },
    /// There are few equations per unknown.
    #[error("{samples} samples are few for {unknowns} unknown parameters")]
    FewSamples {
        /// Samples of an output.
        samples: usize,
        /// Unknown parameters of an output.
        unknowns: usize,
    },
    /// The inputs do not excite enough directions for the number of parameters.
    #[error("the inputs are persistently exciting only to order {order}, where {wanted} is required")]
    PoorExcitation {
        /// The order of persistent excitation that was found.
        order: usize,
        /// The required order.
        wanted: usize,
    },
    /// The inputs excite some directions only weakly.
    #[error("the inputs are ill-conditioned over {depth} samples: condition number {condition:.1e}")]
    IllConditionedInput {
        /// Number of consecutive samples in each column of the block Hankel matrix.
        depth: usize,
        /// Ratio of the largest to the smallest eigenvalue of the covariance of these samples.
        condition: f64,
    },
    /// The power of an input is concentrated in a small part of the band.
    #[error(
        "99 % of the power of input `{channel}` lies in {low_hz:.4}-{high_hz:.4} Hz: outside this band the model is \
         not reliable"
    )]
    NarrowBand {
        /// The channel.
        channel: String,
        /// Lower edge in Hz.
        low_hz: f64,
        /// Upper edge in Hz.
        high_hz: f64,
    },
    /// The sample rate is high compared with the band of the data.
    #[error(
        "the data lie below {band_hz:.4} Hz but are sampled at {rate_hz:.6} Hz: decimation to {suggested_hz:.6} Hz is \
         suggested"
    )]
    Oversampled {
        /// The rate in Hz.
        rate_hz: f64,
        /// Frequency below which the data lie, in Hz.
        band_hz: f64,
        /// An integer fraction of the rate, in Hz.
        suggested_hz: f64,
    },
    /// The test for direct feedthrough is not possible.
    #[error("whether the plant responds within the sample cannot be tested: {reason}")]
    AdvanceUntested {
        /// The reason.
        reason: String,
    },
}
