//! The search for the effects that explain the gap: a screen of the whole vocabulary, fits of its best entries, and the
//! steps that follow.

pub(crate) mod closest_law;
pub(crate) mod course;
pub(crate) mod leading;
pub(crate) mod levels;
pub(crate) mod linear_cause;
pub(crate) mod modal;
pub(crate) mod over_time;
pub(crate) mod overlap;
pub(crate) mod ports;
mod price;
mod reconsider;
pub(crate) mod rules;
pub(crate) mod screen;
pub(crate) mod shape;
pub(crate) mod stage;
pub(crate) mod stepwise;
pub(crate) mod stochastic;
pub(crate) mod windows;
