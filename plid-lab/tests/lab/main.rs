//! Experiments, from config to report.

mod merge;
mod refinement;
mod run;
mod stream;
