//! Forces along a strut that do not come from an actuator.

mod coloured;
mod narrowband;

pub use coloured::ColouredDisturbance;
pub use narrowband::{NarrowbandDisturbance, NarrowbandLaw};
