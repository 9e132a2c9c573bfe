//! What all studies share: the machine, the journal that a study resumes from, strict configs, files.
//!
//! A study is a list of cells with a key each. It measures them, appends each to the [`Journal`], and makes its files from
//! the journal when all are there.

mod error;
mod files;
mod journal;
mod machine;

pub use error::StudyError;
pub use files::{write, write_csv, write_json};
pub use journal::Journal;
pub use machine::{Cache, Machine};
pub use plid_data::config::{ConfigError, from_toml_checked, read_checked, to_toml};
pub use plid_report::{Progress, Silent};
