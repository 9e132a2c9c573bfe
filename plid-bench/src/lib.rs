//! Studies of plid's speed, numerical stability and conditional expectations on the user's machine, and the benches.

pub mod expectations;
pub mod speed;
pub mod stability;
pub mod study;
mod workload;

pub use workload::{Loop, Noise, Record, Workload};
