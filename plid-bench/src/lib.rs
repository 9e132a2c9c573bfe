//! Studies of plid on the own machine: how fast it is, how sound it stays, which expectations it should take; and the benches.

pub mod expectations;
pub mod speed;
pub mod stability;
pub mod study;
mod workload;

pub use workload::{Loop, Noise, Record, Workload};
