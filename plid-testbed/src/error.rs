//! Errors of a config or an input, and warnings.

use std::fmt;

/// An error of the testbed. `key` is the path of the config's key, as in `noise.sensor_rms_v`.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TestbedError {
    /// The value is zero, negative, infinite or not a number.
    #[error("`{key}` must be positive and finite, not {value}")]
    NotPositive {
        /// Path of the key.
        key: &'static str,
        /// Its value.
        value: f64,
    },
    /// The value is too large to compute with.
    #[error("`{key}` must be at most {most}, not {value}")]
    TooLarge {
        /// Path of the key.
        key: &'static str,
        /// Its value.
        value: f64,
        /// Bound.
        most: f64,
    },
    /// The value is negative, infinite or not a number.
    #[error("`{key}` must be zero or more and finite, not {value}")]
    Negative {
        /// Path of the key.
        key: &'static str,
        /// Its value.
        value: f64,
    },
    /// The value is infinite or not a number.
    #[error("`{key}` must be finite, not {value}")]
    NotFinite {
        /// Path of the key.
        key: &'static str,
        /// Its value.
        value: f64,
    },
    /// A whole number is outside its range.
    #[error("`{key}` must be from {least} to {most}, not {value}")]
    OutOfRange {
        /// Path of the key.
        key: &'static str,
        /// Its value.
        value: usize,
        /// Least allowed value.
        least: usize,
        /// Largest allowed value.
        most: usize,
    },
    /// The sample rate is outside the range in which the truss can be simulated.
    #[error("`sample_rate_hz` must be from {least} to {most}, not {value}")]
    Rate {
        /// Its value, Hz.
        value: f64,
        /// Least allowed rate, Hz.
        least: f64,
        /// Largest allowed rate, Hz.
        most: f64,
    },
    /// A frequency is not below half the sample rate.
    #[error("`{key}` is {value} Hz, not below half the sample rate ({nyquist_hz} Hz)")]
    AboveNyquist {
        /// Path of the key.
        key: &'static str,
        /// The frequency, Hz.
        value: f64,
        /// Half the sample rate, Hz.
        nyquist_hz: f64,
    },
    /// The multisine has no line in its band.
    #[error(
        "`{key}`: no multiple of {spacing_hz} Hz (the sample rate over the period) lies from {low_hz} to {high_hz} Hz"
    )]
    NoLines {
        /// Path of the key.
        key: &'static str,
        /// Distance between the lines that the period allows, Hz.
        spacing_hz: f64,
        /// Lower end of the band, Hz.
        low_hz: f64,
        /// Upper end of the band, Hz.
        high_hz: f64,
    },
    /// The record would have no sample, or too many.
    #[error(
        "`duration_s` of {duration_s} s at {sample_rate_hz} Hz gives {samples} samples; there must be from 1 to {most} \
         (over all repeats)"
    )]
    RecordLength {
        /// Duration of a record, s.
        duration_s: f64,
        /// Sample rate, Hz.
        sample_rate_hz: f64,
        /// Samples over all repeats.
        samples: f64,
        /// Largest number of samples allowed.
        most: usize,
    },
    /// The drift would make a mode's stiffness zero or negative before the last record ends.
    #[error(
        "a stiffness drift (`effects.stiffness_drift_per_s`) of {rate} a second leaves no stiffness after {end_s} s, \
         the end of the last record"
    )]
    NoStiffness {
        /// Relative change of stiffness per second.
        rate: f64,
        /// Time at the end of the last repeat, s.
        end_s: f64,
    },
    /// A value of an effect is wrong.
    #[error("`effects.list`, number {number} ({kind}): {source}")]
    Effect {
        /// Its number in the list, from 1.
        number: usize,
        /// Its kind.
        kind: &'static str,
        /// What is wrong with it.
        source: Box<TestbedError>,
    },
    /// An input given as an array has the wrong shape.
    #[error("the input has {rows} rows and {columns} columns; it must have at least one row and {INPUTS} \
        columns", INPUTS = crate::INPUTS)]
    InputShape {
        /// Rows (samples).
        rows: usize,
        /// Columns (channels).
        columns: usize,
    },
    /// An input given as an array holds NaN or infinity.
    #[error("the input is {value} at sample {sample}, channel u{}", channel + 1)]
    InputNotFinite {
        /// Sample, from 0.
        sample: usize,
        /// Channel, from 0.
        channel: usize,
        /// The value.
        value: f64,
    },
    /// An effect made the structure unstable.
    #[error(
        "the structure's motion grew beyond all bounds at sample {sample} of repeat {repeat}; a softening joint may be \
         too strong"
    )]
    Diverged {
        /// Sample, from 0.
        sample: usize,
        /// Repeat, from 0.
        repeat: usize,
    },
}

/// A remark on a valid simulation.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Warning {
    /// Modes lie above half the sample rate. Their response appears in the records at other frequencies.
    ModesAboveNyquist {
        /// Number of these modes.
        count: usize,
        /// The highest of them, Hz.
        highest_hz: f64,
        /// Half the sample rate, Hz.
        nyquist_hz: f64,
    },
    /// The DAC clipped the command.
    CommandClipped {
        /// Channel, from 0.
        channel: usize,
        /// Number of samples clipped.
        samples: usize,
    },
    /// The ADC clipped an output.
    OutputClipped {
        /// Repeat, from 0.
        repeat: usize,
        /// Channel, from 0.
        channel: usize,
        /// Number of samples clipped.
        samples: usize,
    },
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Warning::ModesAboveNyquist { count, highest_hz, nyquist_hz } => write!(
                f,
                "{count} modes, up to {highest_hz} Hz, lie above half the sample rate ({nyquist_hz} Hz) and appear \
                 folded"
            ),
            Warning::CommandClipped { channel, samples } => {
                write!(f, "the DAC clipped u{} in {samples} samples", channel + 1)
            }
            Warning::OutputClipped { repeat, channel, samples } => {
                write!(f, "the ADC clipped y{} in {samples} samples of repeat {}", channel + 1, repeat + 1)
            }
        }
    }
}
