//! Settings of the signal processing.

use super::group::group;

group! {
    /// The processing of records before any fit: peaks of the residual's frequency response, converters, dropouts and
    /// lines.
    SignalSettings {
        /// Power of a peak in the residual's frequency response, over that of the largest peak, above which the peak
        /// suggests a missing mode.
        least_peak: f64 = 0.05, "1", 0.0..=1.0;
        /// Relative difference in frequency below which two peaks belong to one resonance.
        same_peak: f64 = 0.04, "1", 0.0..=1.0;
        /// Largest number of peaks that are offered to effects.
        most_peaks: usize = 2, "peaks", 0.0..=100.0;
        /// Ratio of a converter's step to the finest step of all channels above which the converter may be coarse.
        coarse_step: f64 = 2.5, "1", 1.0..=1e9;
        /// Ratio of the step to the noise above which such a converter is coarse: noise hides a finer step. The noise
        /// is the declared one, or that of the records without input if it is larger.
        coarse_over_noise: f64 = 1.5, "1", 0.0..=1e9;
        /// The same ratio above which a converter is coarse whatever the steps of the other channels are.
        coarse_alone: f64 = 4.0, "1", 0.0..=1e9;
        /// Smallest number of values in the two codes next to zero for which truncation can be distinguished from
        /// rounding.
        truncation_values: f64 = 20.0, "values", 1.0..=1e9;
        /// Smallest number of runs of repeated values in an output with dropouts: fewer occur by chance.
        dropouts: usize = 4, "runs", 1.0..=1e9;
        /// Ratio of a value to an extreme value above which the value may be clipped.
        near_extreme: f64 = 0.85, "1", 0.0..=1.0;
        /// Share of a record's values near the extremes above which the channel clips rather than only reaches a peak.
        clipped_share: f64 = 0.01, "1", 0.0..=1.0;
        /// Smallest error of a repeated value, in standard deviations of the declared noise.
        repeat_error: f64 = 6.0, "std", 0.0..=1e6;
        /// Smallest error of a repeated value over the median of its neighbours' errors: five medians are 3.4 standard
        /// deviations.
        repeat_over_median: f64 = 5.0, "1", 0.0..=1e6;
        /// Largest errors just before and just after a repeated value, over the error of the value itself.
        repeat_isolation: f64 = 0.5, "1", 0.0..=1.0;
        /// Power of a line over the median of its neighbourhood above which the line counts. Noise that excites a
        /// resonance exceeds such a threshold ten times as often as the exponential distribution of the power predicts.
        /// A line of half the noise's RMS in a record of 3200 samples exceeds the median by a factor of 250.
        line_prominence: f64 = 60.0, "1", 1.0..=1e9;
        /// Share of an input's power at the frequency of a line above which the line may be the plant's response. A few
        /// bins of an input with a broad spectrum hold a much smaller share.
        driven_share: f64 = 0.05, "1", 0.0..=1.0;
        /// Power of a line of a periodic input, over that of its strongest line, above which the input drives the
        /// line. The lines due to rounding by a converter have less power.
        driven_line: f64 = 1e-3, "1", 0.0..=1.0;
    }
}
