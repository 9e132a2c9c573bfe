//! Studies of plid on the user's machine: its speed, its numerical stability and its conditional expectations; and the
//! benches.

pub mod expectations;
pub mod speed;
pub mod stability;
pub mod study;
mod workload;

pub use workload::{Loop, Noise, Record, Workload};
