//! The common parts of all studies: the machine, the journal from which a study resumes, strict configs, and files.
//!
//! A study is a list of cells, each with a key. It measures them, appends each to the [`Journal`], and writes its files
//! from the journal when all are complete. A [`shard`] measures a part of them in its own folder, and
//! [`merge_shards`] joins the journals of all shards.

mod error;
mod files;
mod journal;
mod machine;
mod shards;

pub use error::StudyError;
pub use files::{write, write_csv, write_json};
pub use journal::Journal;
pub use machine::{Cache, Machine};
pub use plid_data::config::{ConfigError, from_toml_checked, read_checked, to_toml};
pub use plid_work::{Progress, Shard, Silent};
pub use shards::{merge_shards, shard};
