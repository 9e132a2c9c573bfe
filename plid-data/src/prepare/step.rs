//! The preparation steps, for manifest and report.
use super::decimate::Decimation;
use serde::{Deserialize, Serialize};

/// One step of preparation; `Display` says it in a sentence.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, thiserror::Error)]
#[serde(tag = "step", rename_all = "kebab-case")]
pub enum Step {
    /// Repeats of one input were averaged.
    #[error("{repeats} repeats of {samples} samples were averaged ({skipped} left out at the start)")]
    Averaged {
        /// Repeats that went into the average.
        repeats: usize,
        /// Samples of a repeat.
        samples: usize,
        /// Repeats left out at the beginning.
        skipped: usize,
    },
    /// The rate was lowered.
    #[error("decimated from {} to {} Hz after a linear-phase filter without delay; {} samples at each end are \
        lost", .0.from_hz, .0.to_hz, .0.edge)]
    Decimated(Decimation),
    /// Means were removed.
    #[error("the mean of each channel over the training part was removed")]
    MeanRemoved,
    /// Straight lines were removed.
    #[error("a straight line, fitted to the training part of each record, was removed from each channel")]
    LineRemoved,
    /// The input was advanced.
    #[error("the input was advanced by one sample, because the plant \
        {} to respond within the sample", if *.by_test { "was found" } else { "is declared" })]
    Advanced {
        /// Whether a test decided it, or the config.
        by_test: bool,
    },
    /// Channels were scaled.
    #[error("each channel was divided by its RMS over the training part")]
    Scaled,
}
