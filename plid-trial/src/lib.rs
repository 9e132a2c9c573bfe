//! Blind trials: the diagnosis is checked on cases whose effect is withheld from it.
//!
//! [`draw()`] writes the cases into one directory and their sealed truths into another. [`diagnose()`] reads only the
//! first. [`score()`] first records the hash of all answers, then checks the sealed files against the committed hashes,
//! and only then opens them.

pub mod ablation;
mod answer;
pub mod baselines;
pub mod calibrate;
pub mod ceiling;
pub mod config;
mod diagnose;
mod draw;
mod error;
mod files;
pub mod judge;
pub mod main_cause;
mod manifest;
mod merge;
mod plan;
mod program;
pub mod reliability;
mod report;
mod score;
pub mod scores;
mod seal;
pub mod statistics;
mod targets;
pub mod truth;
pub mod vocabulary;

pub use ablation::{diagnose_without, score_without};
pub use answer::{Answer, Answered, Seconds};
pub use calibrate::{Calibrated, Opened, calibrate};
pub use config::TrialConfig;
pub use diagnose::{Done, Options, diagnose, diagnose_alone, diagnose_with};
pub use draw::{Drawn, draw};
pub use error::TrialError;
pub use manifest::{DrawnCase, config_of};
pub use merge::merge;
pub use plan::Arm;
pub use plid_work::Shard;
pub use program::Program;
pub use score::{Extent, score};
