//! Settings of the audit of a case.

use super::group::group;

group! {
    /// The audit of records, channels and wiring.
    AuditSettings {
        /// Gap from which the audit searches for crossed, negated, delayed or rescaled channels.
        least_gap: f64 = 0.1, "1", 0.0..=1e6;
        /// A mismatch of channels is reported if it reduces the gap to this share: the squared gap is then about
        /// halved.
        reported: f64 = 0.7, "1", 0.0..=1.0;
        /// A mismatch of channels is corrected if it reduces the gap to this share, which no single effect of a sound
        /// signal chain imitates.
        corrected: f64 = 0.5, "1", 0.0..=1.0;
        /// Number of independent values for which the squared gaps count that remain with and without the correction.
        wiring_values: f64 = 20.0, "values", 0.0..=1e6;
        /// Odds for a mismatch that leaves as much as the channels as recorded: an effect that happens to have a gain
        /// of minus one, or a delay of a whole block, is a coincidence.
        wiring_odds: f64 = 20.0, "1", 1e-9..=1e9;
        /// Gap from which several mismatches may occur together. The search then starts from every order and sign of
        /// the outputs: two exchanged channels make a gap of about one.
        several: f64 = 0.7, "1", 0.0..=1e6;
        /// These starts are tried only if a plain search leaves a larger gap than this: dozens of starts cost seconds.
        several_left: f64 = 0.25, "1", 0.0..=1e6;
        /// Factor by which every change of the wiring must reduce the squared gap.
        change_price: f64 = 1.5, "1", 1.0..=1e6;
        /// Largest relative difference of the factors of all channels of one side for them to count as one change, such
        /// as of the unit: estimates of one factor scatter where the simulation is wrong in other ways too.
        same_factor: f64 = 0.05, "1", 0.0..=1.0;
        /// Delay from which all channels count as delayed, as by a block of samples. A shorter delay is an effect,
        /// which is fitted together with lags: a first-order lag that looks like a longer delay would remove most of
        /// the signal.
        shortest_delay: usize = 16, "samples", 1.0..=1e6;
        /// Largest relative distance of a factor from one between units.
        unit_distance: f64 = 0.08, "1", 0.0..=1.0;
        /// Factor between units above which a single channel may have it. A smaller factor of a single channel may be a
        /// gain, and if the simulation is wrong in other ways too, least squares underestimate it.
        single_factor: f64 = 9.0, "1", 1.0..=1e9;
        /// Factor above which a channel has other units, even if it is not a factor between known units.
        unknown_factor: f64 = 20.0, "1", 1.0..=1e9;
        /// Periods of the lowest mode that a record must contain: in fewer, the mode shows neither its decay nor its
        /// frequency.
        periods: f64 = 3.0, "periods", 0.0..=1e6;
        /// Share of missing samples of a channel from which the report warns that the gap is uncertain.
        many_missing: f64 = 0.2, "1", 0.0..=1.0;
        /// Samples at the extreme value of a channel that clips.
        clipped_samples: usize = 5, "samples", 1.0..=1e9;
        /// Ratio of these to the samples at the next value. A signal's tail gets thinner outwards; even a sine has only
        /// 2.4 times as many samples in its last code as in the one before.
        clipped_ratio: usize = 5, "1", 1.0..=1e6;
        /// Different values that a channel must take before clipping is tested: a switched signal has few, and all of
        /// them are extremes.
        clipped_values: usize = 16, "values", 2.0..=1e9;
        /// Separate visits of a channel that clips to its extreme value. A command in steps holds its largest value
        /// once.
        clipped_visits: usize = 3, "visits", 1.0..=1e9;
        /// States of a surrogate model if the case does not state them.
        surrogate_states: usize = 24, "states", 2.0..=1000.0;
        /// Relative error on data outside the fit below which a surrogate model is the simulator itself: a hundredth of
        /// typical noise.
        exact: f64 = 1e-4, "1", 0.0..=1.0;
        /// Relative error above which a linear model does not represent a simulator well.
        poor: f64 = 0.05, "1", 0.0..=1e3;
    }
}
