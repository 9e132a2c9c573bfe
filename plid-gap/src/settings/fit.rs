//! Settings of the fits.

use super::group::group;

group! {
    /// The fits of linear parameters and effects.
    FitSettings {
        /// Linear parameters that are further from zero than this, in standard deviations of their prior, are taken as
        /// the trace of an effect and are brought back before a search.
        prior_bound: f64 = 2.5, "std", 0.0..=1e6;
        /// Information about a parameter, over that of its prior, above which the records determine the parameter.
        determined: f64 = 10.0, "1", 1.0..=1e9;
        /// Largest change of a mode's parameter, in standard deviations of its prior, for which a fit is not repeated
        /// from zero. After so small a change, a repeated fit could change the effect by no more than its interval
        /// allows.
        repeated_from: f64 = 1.0, "std", 0.0..=1e6;
        /// Largest leverage of a residual. A residual that alone determines a parameter contains no information about
        /// its own noise.
        most_leverage: f64 = 0.9, "1", 0.0..=0.999;
    }
}
