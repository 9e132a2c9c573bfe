//! Settings of the audit of a case.

use super::group::group;

group! {
    /// The audit of records, channels and wiring.
    AuditSettings {
        /// Gap above which the audit searches for exchanged, negated, delayed or rescaled channels.
        least_gap: f64 = 0.1, "1", 0.0..=1e6;
        /// A mismatch of channels is reported if its correction reduces the gap to this share: the squared gap is then
        /// about halved.
        reported: f64 = 0.7, "1", 0.0..=1.0;
        /// A mismatch of channels is corrected if the correction reduces the gap to this share, which no single effect
        /// of a sound signal chain imitates.
        corrected: f64 = 0.5, "1", 0.0..=1.0;
        /// Number of independent values from which the squared gaps with and without the correction are assumed to
        /// come.
        wiring_values: f64 = 20.0, "values", 0.0..=1e6;
        /// Odds of a mismatch whose correction leaves the same gap as the recorded channels do. An effect that happens
        /// to have a gain of minus one, or a delay of a whole block, would be a coincidence.
        wiring_odds: f64 = 20.0, "1", 1e-9..=1e9;
        /// Gap above which several mismatches may occur together. The search then starts from every order and sign of
        /// the outputs: two exchanged channels cause a gap of about one.
        several: f64 = 0.7, "1", 0.0..=1e6;
        /// These starts are tried only if a plain search leaves a larger gap than this, because dozens of starts take
        /// seconds.
        several_left: f64 = 0.25, "1", 0.0..=1e6;
        /// Factor by which every change of the wiring must reduce the squared gap.
        change_price: f64 = 1.5, "1", 1.0..=1e6;
        /// Largest relative difference between the factors of all inputs or of all outputs for them to count as one
        /// change, such as another unit. Estimates of one factor scatter if the simulation is wrong in other ways too.
        same_factor: f64 = 0.05, "1", 0.0..=1.0;
        /// Shortest delay of all channels that counts as a mismatch, such as a delay by a block of samples. A shorter
        /// delay is an effect and is fitted together with lags: a first-order lag that looks like a longer delay would
        /// remove most of the signal.
        shortest_delay: usize = 16, "samples", 1.0..=1e6;
        /// Largest relative difference between a factor and a known factor between units.
        unit_distance: f64 = 0.08, "1", 0.0..=1.0;
        /// Smallest factor between units that is accepted for a single channel. A smaller factor of a single channel
        /// may be a gain, which least squares underestimate if the simulation is wrong in other ways too.
        single_factor: f64 = 9.0, "1", 1.0..=1e9;
        /// Factor above which a channel has another unit, even if it is not a factor between known units.
        unknown_factor: f64 = 20.0, "1", 1.0..=1e9;
        /// Number of periods of the lowest mode that a record must contain. In fewer periods, the mode shows neither
        /// its decay nor its frequency.
        periods: f64 = 3.0, "periods", 0.0..=1e6;
        /// Share of missing samples of a channel above which the report warns that the gap is uncertain.
        many_missing: f64 = 0.2, "1", 0.0..=1.0;
        /// Smallest number of samples at the extreme value of a channel that clips.
        clipped_samples: usize = 5, "samples", 1.0..=1e9;
        /// Smallest ratio of this number to the number of samples at the next value. The tail of a signal gets thinner
        /// outwards; even a sine has only 2.4 times as many samples in its last code as in the one before.
        clipped_ratio: usize = 5, "1", 1.0..=1e6;
        /// Number of distinct values that a channel must take before clipping is tested. A switched signal has few
        /// values, and all of them are extremes.
        clipped_values: usize = 16, "values", 2.0..=1e9;
        /// Smallest number of separate visits to the extreme value by a channel that clips. A command in steps holds
        /// its largest value only once.
        clipped_visits: usize = 3, "visits", 1.0..=1e9;
        /// Number of states of a surrogate model if the case does not state it.
        surrogate_states: usize = 24, "states", 2.0..=1000.0;
        /// Relative error on data outside the fit below which a surrogate model is the simulator itself: a hundredth of
        /// typical noise.
        exact: f64 = 1e-4, "1", 0.0..=1.0;
        /// Relative error above which a linear model does not represent a simulator well.
        poor: f64 = 0.05, "1", 0.0..=1e3;
    }
}
