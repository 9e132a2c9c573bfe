//! The preparation steps, for the manifest and the report.
use super::decimate::Decimation;
use serde::{Deserialize, Serialize};

/// One step of the preparation; `Display` states it in a sentence.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, thiserror::Error)]
#[serde(tag = "step", rename_all = "kebab-case")]
pub enum Step {
    /// Repeats of one input were averaged.
    #[error("{repeats} repeats of {samples} samples were averaged ({skipped} left out at the start)")]
    Averaged {
        /// Number of repeats in the average.
        repeats: usize,
        /// Number of samples of a repeat.
        samples: usize,
        /// Number of repeats that were left out at the beginning.
        skipped: usize,
    },
    /// The sample rate was reduced.
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
        /// Whether a test or the config decided this.
        by_test: bool,
    },
    /// Channels were scaled.
    #[error("each channel was divided by its RMS over the training part")]
    Scaled,
}
