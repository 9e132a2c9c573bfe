//! The part of a larger task that one process does.

use plid_work::Shard;

use super::{Failure, Voice, voice};

/// Work that several processes or machines share.
#[derive(clap::Args, Default)]
pub struct Part {
    /// Run only shard i of N. All shards have the same output directory, and each continues where it was interrupted.
    #[arg(long, value_name = "i/N")]
    pub shard: Option<Shard>,
    /// Merge the results of all shards without computing anything; a missing or incomplete shard is an error.
    #[arg(long, conflicts_with = "shard")]
    pub merge: bool,
}

impl Part {
    /// Whether other processes use the same output directory.
    pub fn is_one_of_several(&self) -> bool {
        self.shard.is_some() || self.merge
    }

    /// Reports that a shard of a study is complete. A single shard has no results.
    pub fn tell_shard(shard: Shard, voice: Voice) -> Result<(), Failure> {
        match voice {
            Voice { json: true, .. } => voice::print(&format!("{}\n", serde_json::json!({ "shard": shard }))),
            Voice { quiet: true, .. } => Ok(()),
            _ => voice::print(&format!("{shard} is complete; --merge merges all shards\n")),
        }
    }
}
