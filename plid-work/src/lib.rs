//! Support for long calculations: progress reports and interruption, sharing among several machines, and the
//! isolation of a part that panics.

mod caught;
mod progress;
mod shard;

pub use caught::caught;
pub use progress::{Inner, Progress, Silent};
pub use shard::{SHARD, SHARDS, Shard, require_whole, shard_folders};
