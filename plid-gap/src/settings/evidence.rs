//! Settings of the evidence that does not enter the verdict.

use super::group::group;

group! {
    /// The evidence that does not enter the verdict: lines of multisines, resonances of single records, adaptive runs.
    EvidenceSettings {
        /// Smallest number of odd lines without input, and of even lines, for which their mean power is stated.
        least_lines: usize = 8, "lines", 1.0..=1e6;
        /// Excess of the power of such lines over the noise, in standard deviations of the mean power, above which a
        /// nonlinearity is stated.
        line_excess: f64 = 6.0, "std", 0.0..=1e6;
        /// Ratio of the responses at odd and at even lines above which a nonlinearity is mostly odd, or mostly even.
        mostly: f64 = 3.0, "1", 1.0..=1e6;
        /// Share of its prior standard deviation to which a single record must narrow a frequency for the mode to be
        /// visible there.
        frequency_narrowed: f64 = 0.05, "1", 0.0..=1.0;
        /// Share of its prior standard deviation to which this record must also narrow the damping ratio of the mode.
        damping_narrowed: f64 = 0.2, "1", 0.0..=1.0;
        /// Smallest number of records for which the trend of a resonance is stated.
        trend_records: usize = 3, "records", 2.0..=1000.0;
        /// Smallest number of records of an adaptive run for which the trend of a resonance is stated.
        tracked_records: usize = 4, "records", 2.0..=1000.0;
        /// Change of a frequency, over its scatter about the trend, above which the trend is stated.
        trend_change: f64 = 6.0, "1", 0.0..=1e6;
        /// Ratio by which a trend with time must be clearer than one with the level to be stated in its place: records
        /// are often taken at rising levels.
        time_over_level: f64 = 1.5, "1", 1.0..=1e6;
        /// Damping ratio above which a pole of an adaptive model does not count as a resonance.
        tracked_damping: f64 = 0.2, "1", 0.0..=1.0;
        /// Largest relative difference in frequency between a mode and the resonance of an adaptive model that is
        /// identified with it.
        tracked_distance: f64 = 0.03, "1", 0.0..=1.0;
    }
}
