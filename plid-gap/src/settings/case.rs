//! Settings of the reading of a case.

use super::group::group;

group! {
    /// The reading of a case: levels, periods and the records that are held out. The misfit of a period is
    /// RMS(u(k + P) - u(k)) over sqrt(2) RMS(u): 0 where an input repeats exactly, 1 where it does not repeat at all.
    CaseSettings {
        /// Ratio of two levels below which they count as one level.
        same_level: f64 = 1.15, "1", 1.0..=1e3;
        /// Largest misfit of an input that repeats: ten times that of a measured one.
        period_misfit: f64 = 0.1, "1", 0.0..=1.0;
        /// Misfit of a measured input at its period, from noise: shakers and amplifiers have at most this. Shifts whose
        /// misfits differ by less are equally good periods, and the shortest is taken.
        measured_misfit: f64 = 0.01, "1", 0.0..=1.0;
        /// Misfit from which two stretches of an input are unrelated. A period is searched for only beyond a shift of
        /// that misfit, because any slow input resembles itself a few samples later.
        unrelated_misfit: f64 = 0.5, "1", 0.0..=1.0;
        /// A period whose misfit is below this share of the declared period's misfit replaces it.
        better_misfit: f64 = 0.7, "1", 0.0..=1.0;
        /// Largest relative distance of such a period from the declared one.
        period_distance: f64 = 0.125, "1", 0.0..=1.0;
        /// Share of a driven record that is held out if the case names no held-out record and no whole record can be
        /// spared.
        held_out_share: f64 = 0.25, "1", 0.0..=0.9;
        /// Level of a record, over the loudest one, from which it may be held out. The gap of a quieter record is that
        /// of its noise.
        least_held_out_level: f64 = 0.05, "1", 0.0..=1.0;
        /// Gap of the simulation as given in the held-out record over that of every fitted one, or in a fitted one over
        /// that of the held-out one, from which that record is divided into a fitted and a held-out part. What one
        /// record shows, such as a stop, must be fitted and judged there.
        alone_gap: f64 = 3.0, "1", 1.0..=1e6;
    }
}
