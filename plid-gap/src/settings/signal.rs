//! Settings of the signal processing.

use super::group::group;

group! {
    /// The processing of records before any fit: peaks of the residual's frequency response, converters, dropouts and
    /// lines.
    SignalSettings {
        /// Share of the largest peak of the residual's frequency response from which a peak suggests a missing mode.
        least_peak: f64 = 0.05, "1", 0.0..=1.0;
        /// Relative distance below which two peaks belong to one resonance.
        same_peak: f64 = 0.04, "1", 0.0..=1.0;
        /// Most peaks that are offered to effects.
        most_peaks: usize = 2, "peaks", 0.0..=100.0;
        /// Step of a converter over the finest step of all channels from which the converter may be coarse.
        coarse_step: f64 = 2.5, "1", 1.0..=1e9;
        /// Step over the declared noise from which such a converter is coarse: the noise of a finer one hides its
        /// steps.
        coarse_over_noise: f64 = 1.5, "1", 0.0..=1e9;
        /// Step over the declared noise from which a converter is coarse whatever the steps of the other channels are.
        coarse_alone: f64 = 4.0, "1", 0.0..=1e9;
        /// Values in the two codes next to zero from which truncation can be distinguished from rounding.
        truncation_values: f64 = 20.0, "values", 1.0..=1e9;
        /// Runs of repeated values from which an output has dropouts: fewer occur by chance.
        dropouts: usize = 4, "runs", 1.0..=1e9;
        /// Share of an extreme value from which a value may be clipped.
        near_extreme: f64 = 0.85, "1", 0.0..=1.0;
        /// Share of a record's values near the extremes from which the channel clips rather than only reaching a peak.
        clipped_share: f64 = 0.01, "1", 0.0..=1.0;
        /// Least error of a repeated value, in standard deviations of the declared noise.
        repeat_error: f64 = 6.0, "std", 0.0..=1e6;
        /// Least error of a repeated value over the median of its neighbours' errors: five medians are 3.4 standard
        /// deviations.
        repeat_over_median: f64 = 5.0, "1", 0.0..=1e6;
        /// Largest errors just before and just after a repeated value, over its own.
        repeat_isolation: f64 = 0.5, "1", 0.0..=1.0;
        /// Power of a line over the median of its neighbourhood from which the line counts. A resonance in noise
        /// reaches ten times the chance of an exponential tail; a line of half the noise's RMS in a record of 3200
        /// samples exceeds the median by a factor of 250.
        line_prominence: f64 = 60.0, "1", 1.0..=1e9;
        /// Share of an input's power at the frequency of a line from which the line may be the plant's response. Of an
        /// input with a broad spectrum, a few lines of the resolution hold a much smaller share.
        driven_share: f64 = 0.05, "1", 0.0..=1.0;
    }
}
