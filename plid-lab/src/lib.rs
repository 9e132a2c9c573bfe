//! Experiments of plid: configs, data files, runs, reports.
pub mod data;
pub mod experiment;
pub mod identify;
pub mod model;
pub mod prepare;
pub mod recommendation;
pub mod report;
pub mod run;
pub mod signal;
pub mod variant;
