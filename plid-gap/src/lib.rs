//! Where a simulation disagrees with its records, which unmodelled effect causes it, and how far the gap shrinks once it is added.

pub mod ablation;
mod answer;
pub mod audit;
pub mod beside;
#[cfg(test)]
mod blind;
pub mod case;
mod closest_law;
pub mod codes;
pub mod coloured;
pub mod diagnose;
pub mod diagnosis;
pub mod effects;
pub mod error;
pub mod explain;
pub mod gap;
pub mod held_out;
mod lanes;
pub mod levels;
pub mod lines;
pub mod locate;
pub mod missing;
mod modal;
pub mod model_error;
pub mod next;
pub mod noise;
mod notch;
pub mod nuisance;
pub mod plant;
mod ports_fit;
pub mod predict;
pub mod prepare;
pub mod problem;
pub mod record;
pub mod refit;
pub mod report;
pub mod resonances;
pub mod robust;
mod runner;
mod scoring;
pub mod screen;
pub mod separable;
pub mod shape;
pub mod shrink;
pub mod simulate;
pub mod stepwise;
pub mod surrogate;
#[cfg(test)]
mod testing;
pub mod thresholds;
pub mod tones;
pub mod tracks;
pub mod transform;
pub mod trend;
#[cfg(test)]
mod truss;
pub mod unseen;
pub mod verdict;
pub mod wandering;
pub mod whiten;
mod write;
mod written;

pub use ablation::Step;
pub use diagnose::{Evidence, Groundwork, Outcome, diagnose, diagnose_without};
pub use error::GapError;
pub use write::write;
