//! Where a simulation disagrees with its records, which unmodelled effect causes it, and how far the gap shrinks once it is added.
//!
//! A case passes through the modules in this order, which is that of the method: it is read (`case`) and audited (`audit`); the simulation is taken
//! apart into its modes (`plant`); the noise is estimated (`signal`, `noise`) and a problem of least squares made of it all (`prepare`, `fit`); effects
//! (`effects`) are simulated (`simulate`) and searched for (`search`); what was found is judged (`judge`), and answered (`answer`, `report`).
//! `evidence` shows what the diagnosis does not rest on. `diagnose` calls them one after the other.

pub mod answer;
mod audit;
pub mod case;
pub mod diagnose;
pub mod effects;
mod error;
mod evidence;
mod fit;
mod judge;
mod noise;
mod plant;
mod prepare;
pub mod report;
pub mod research;
mod search;
mod settings;
mod signal;
mod simulate;
#[cfg(test)]
mod testing;
mod words;

pub use diagnose::{Evidence, Groundwork, Outcome, diagnose, diagnose_without};
pub use error::GapError;
pub use report::write;
pub use settings::step::Step;
