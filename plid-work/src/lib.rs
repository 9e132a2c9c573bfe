//! Work that takes long: how it reports its progress and is interrupted, how several machines share it, and how a part
//! that panics does not take the others with it.

mod caught;
mod progress;
mod shard;

pub use caught::caught;
pub use progress::{Inner, Progress, Silent};
pub use shard::{SHARD, SHARDS, Shard, require_whole, shard_folders};
