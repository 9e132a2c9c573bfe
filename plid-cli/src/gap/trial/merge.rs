use std::path::PathBuf;

use plid_trial::merge;

use super::{Failure, Voice, voice};

/// Merge the answers of all shards into T/answers.
///
/// Each shard must be complete and present exactly once; the error names the number of one that is not.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  plid gap trial merge T\n  plid gap trial merge T a/1-of-2 b/2-of-2")]
pub struct Arguments {
    /// The cases.
    #[arg(value_name = "T")]
    trial: PathBuf,
    /// Folders of shards [default: all in T/shards].
    #[arg(value_name = "SHARD")]
    shards: Vec<PathBuf>,
}

/// Runs the command.
pub fn execute(arguments: &Arguments, voice: Voice) -> Result<(), Failure> {
    let shards = merge(&arguments.trial, &arguments.shards)?;
    if voice.json {
        return voice::print(&format!("{}\n", serde_json::json!({ "shards": shards })));
    }
    if voice.quiet { Ok(()) } else { voice::print(&format!("{shards} shards joined\n")) }
}
