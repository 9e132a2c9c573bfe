//! Experiments of plid: configs, data files, runs, reports.
pub mod data;
pub mod experiment;
pub mod identify;
pub mod merge;
pub mod prepare;
pub mod report;
pub mod run;
