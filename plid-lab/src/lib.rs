//! Experiments of plid: configs, data files, runs, reports.
pub mod data;
pub mod model;
pub mod prepare;
pub mod report;
pub mod signal;
