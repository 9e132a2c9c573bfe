//! Settings of the answer.

use super::group::group;

group! {
    /// The sentences of the answer.
    AnswerSettings {
        /// Remaining gap, over the gap as given, below which the remainder is called small.
        small_remainder: f64 = 0.1, "1", 0.0..=1.0;
        /// Gap with the effects, over the noise, above which the answer states that a share of the output remains
        /// unexplained. Up to it, hardly anything remains beyond the noise.
        unexplained: f64 = 1.1, "1", 1.0..=1e6;
        /// Probability of a further cause from which a remainder is described however close it is to the noise: from
        /// here on, a further cause is more probable than not.
        further_cause: f64 = 0.5, "1", 0.0..=1.0;
        /// Gap as given, over the noise, below which the gap counts as noise.
        noise_only: f64 = 1.1, "1", 1.0..=1e6;
        /// Share of the gap that a linear refit must close for the report to say that the refit hides the gap.
        hidden_by_refit: f64 = 0.5, "1", 0.0..=1.0;
        /// Share of the gap above which a band is listed among those with the largest shares.
        listed_band: f64 = 0.02, "1", 0.0..=1.0;
        /// Slope of the logarithm of the gap over that of the level above which the report says that the gap grows, or
        /// falls, with the level: halfway between a constant gap and one that is proportional to the level.
        level_slope: f64 = 0.5, "1", 0.0..=10.0;
        /// Lead in probability that a family must have over the effect for sentences to name the family.
        family_lead: f64 = 0.1, "1", 0.0..=1.0;
        /// Factor between the declared noise of a sensor and the noise that the records show, either way, above which
        /// the report says that the declared noise is wrong.
        misdeclared: f64 = 1.2, "1", 1.0..=1e6;
    }
}
