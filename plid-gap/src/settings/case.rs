//! Settings of the reading of a case.

use super::group::group;

group! {
    /// The reading of a case: levels, periods and the records that are held out. The misfit of a period is
    /// RMS(u(k + P) - u(k)) over sqrt(2) RMS(u): 0 where an input repeats exactly, 1 where it does not repeat at all.
    CaseSettings {
        /// Ratio below which two levels count as one level.
        same_level: f64 = 1.15, "1", 1.0..=1e3;
        /// Largest misfit of an input that counts as periodic: ten times the misfit of a measured one.
        period_misfit: f64 = 0.1, "1", 0.0..=1.0;
        /// Misfit of a measured input at its period, which is due to noise. The inputs of shakers and amplifiers have
        /// at most this misfit. Shifts whose misfits differ by less are equally good periods, and the shortest of them
        /// is taken.
        measured_misfit: f64 = 0.01, "1", 0.0..=1.0;
        /// Misfit above which two stretches of an input are unrelated. The search for a period begins at the first
        /// shift with a larger misfit, because any slow input resembles itself a few samples later.
        unrelated_misfit: f64 = 0.5, "1", 0.0..=1.0;
        /// A declared period is refused if the misfit of a period near it is below this share of the declared period's
        /// misfit.
        better_misfit: f64 = 0.7, "1", 0.0..=1.0;
        /// Largest relative distance of such a better period from the declared one.
        period_distance: f64 = 0.125, "1", 0.0..=1.0;
        /// Share of a driven record that is held out if the case names no held-out record and no whole record can be
        /// spared.
        held_out_share: f64 = 0.25, "1", 0.0..=0.9;
        /// Smallest level of a record that may be held out, over the level of the loudest record. The gap of a quieter
        /// record is due to its noise.
        least_held_out_level: f64 = 0.05, "1", 0.0..=1.0;
        /// Ratio of the gap of the simulation as given in the held-out record to the largest gap in a fitted record, or
        /// the reverse, above which the record with the larger gap is divided into a fitted and a held-out part. A
        /// cause that only one record shows, such as a stop, must be fitted and judged in that record.
        alone_gap: f64 = 3.0, "1", 1.0..=1e6;
    }
}
