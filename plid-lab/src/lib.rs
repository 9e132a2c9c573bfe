//! Experiments of plid: configs, runs, merged runs, sweeps.
pub mod experiment;
pub mod merge;
#[cfg(test)]
#[path = "../../plid-data/src/real_file.rs"]
mod real_file;
pub mod run;
pub mod sweep;

pub use plid_data as data;
pub use plid_data::prepare;
pub use plid_identify as identify;
pub use plid_report as report;
