//! Forces along a strut that come from elsewhere, not through an actuator.

mod coloured;
mod narrowband;

pub use coloured::ColouredDisturbance;
pub use narrowband::{NarrowbandDisturbance, NarrowbandLaw};
