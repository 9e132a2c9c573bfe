//! Where a simulation disagrees with its records, which unmodelled effect causes it, and how far the gap shrinks once it is added.

pub mod case;
pub mod effects;
pub mod error;
pub mod noise;
pub mod nuisance;
pub mod plant;
pub mod prepare;
pub mod problem;
pub mod refit;
pub mod record;
pub mod screen;
pub mod simulate;
#[cfg(test)]
mod testing;
pub mod tones;
pub mod transform;
pub mod whiten;

pub use error::GapError;
