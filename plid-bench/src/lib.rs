//! Studies of plid on the own machine: how fast it is and how sound it stays; and the benches.

pub mod speed;
pub mod stability;
pub mod study;
mod workload;

pub use workload::{Loop, Noise, Record, Workload};
