//! Single steps of the diagnosis, for studies that omit one of them, replace it, or compare it with an alternative.
//!
//! A diagnosis does not need them: see [`diagnose`](crate::diagnose()).

pub use crate::audit::{Audit, audit};
pub use crate::diagnose::explain::explain;
pub use crate::fit::problem::{Effort, Fit, Jacobian, Placed, Problem};
pub use crate::fit::refit::{Refit, STEPS as REFIT_STEPS, refit};
pub use crate::judge::next_experiment::next_experiment;
pub use crate::judge::separability::{Predicted, rivals};
pub use crate::judge::shrink::gaps;
pub use crate::judge::verdict::weigh;
pub use crate::plant::Plant;
pub use crate::prepare::{Known, Prepared, prepare};
pub use crate::search::leading::leading;
pub use crate::search::overlap::of_screen;
pub use crate::search::rules::Rules;
pub use crate::search::screen::{Base, screen};
pub use crate::search::stage::polish;
pub use crate::search::stochastic::stochastic_effects;
pub use crate::signal::tones::Tone;
pub use crate::simulate::{Fineness, Run, before_sensors, changed_plant, simulate};

/// The location of the gap by output, band, time and level.
pub mod locate {
    pub use crate::judge::locate::{BANDS, Map, STRETCHES, errors, map};
    pub use crate::judge::side::{places, side};
}
