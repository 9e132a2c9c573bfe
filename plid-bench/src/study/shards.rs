use std::collections::BTreeMap;
use std::fs;
use std::io::ErrorKind;
use std::path::Path;

use plid_work::{SHARD, Shard, require_whole, shard_folders};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::{Journal, StudyError, write_json};

/// The file that says which shard a folder holds, and that it is complete.
#[derive(Serialize, Deserialize)]
struct Complete {
    shard: Shard,
}

/// Does the work of a shard in its own folder in `directory`, and records there when it is complete.
///
/// # Errors
/// Returns the errors of the work, or [`StudyError::File`].
pub fn shard<T>(
    directory: &Path,
    shard: Shard,
    work: impl FnOnce(&Path) -> Result<T, StudyError>,
) -> Result<T, StudyError> {
    let folder = shard.folder(directory);
    let marker = folder.join(SHARD);
    match fs::remove_file(&marker) {
        Err(source) if source.kind() != ErrorKind::NotFound => return Err(StudyError::File { path: marker, source }),
        _ => {}
    }
    let done = work(&folder)?;
    write_json(&marker, &Complete { shard })?;
    Ok(done)
}

/// Joins the journals of all shards of `study` in `directory` to the journal there, and returns how many there were.
///
/// # Errors
/// Returns [`StudyError::Shards`] with the number of a shard that is missing, incomplete or given twice, or the error
/// of a journal, such as one that belongs to another config.
pub fn merge_shards<T: Serialize + DeserializeOwned + Clone>(
    directory: &Path,
    study: &str,
    config: &str,
) -> Result<usize, StudyError> {
    let mut cells: BTreeMap<String, T> = BTreeMap::new();
    let mut found = Vec::new();
    for folder in shard_folders(directory).map_err(StudyError::file(directory))? {
        let marker = folder.join(SHARD);
        if !marker.exists() {
            let shown = folder.display();
            return Err(StudyError::Shards(format!("{shown}: this shard is not complete; run it again")));
        }
        let text = fs::read_to_string(&marker).map_err(StudyError::file(&marker))?;
        let Complete { shard } = serde_json::from_str(&text).map_err(|error| StudyError::Content {
            path: marker,
            line: error.line(),
            reason: error.to_string(),
        })?;
        let journal = Journal::<T>::open(&folder, study, config, true)?;
        cells.extend(journal.cells().iter().map(|(key, cell)| (key.clone(), cell.clone())));
        found.push((shard, folder));
    }
    let of = require_whole(&found).map_err(StudyError::Shards)?;
    // Cells that were measured there without shards are kept.
    for (key, cell) in Journal::<T>::open(directory, study, config, true)?.cells() {
        cells.entry(key.clone()).or_insert_with(|| cell.clone());
    }
    Journal::replace(directory, study, config, &cells)?;
    Ok(of)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(directory: &Path, text: &str, config: &str) -> Result<(), StudyError> {
        let ours: Shard = text.parse().unwrap();
        shard(directory, ours, |folder| {
            let mut journal = Journal::open(folder, "test", config, true)?;
            for index in (0..5).filter(|&index| ours.has(index)) {
                journal.append(&format!("cell {index}"), index)?;
            }
            Ok(())
        })
    }

    #[test]
    fn all_shards_make_one_journal() {
        let directory = tempfile::tempdir().unwrap();
        let at = directory.path();
        let merge = || merge_shards::<usize>(at, "test", "config");
        let said = || merge().unwrap_err().to_string();
        assert_eq!(said(), "there is no shard to merge");
        run(at, "2/2", "config").unwrap();
        assert_eq!(said(), "shard 1 of 2 is missing");
        // A shard that stops early is not complete, even if it was complete before.
        run(at, "1/2", "config").unwrap();
        let broken = |_: &Path| Err::<(), _>(StudyError::Shards("broken off".into()));
        shard(at, "1/2".parse().unwrap(), broken).unwrap_err();
        assert!(said().ends_with("shards/1-of-2: this shard is not complete; run it again"), "{}", said());
        assert!(!at.join("cells.jsonl").exists());
        run(at, "1/2", "config").unwrap();
        assert_eq!(merge().unwrap(), 2);
        let whole = Journal::<usize>::open(at, "test", "config", true).unwrap();
        assert_eq!(whole.cells().values().copied().collect::<Vec<_>>(), [0, 1, 2, 3, 4]);
        let other = merge_shards::<usize>(at, "test", "other").unwrap_err().to_string();
        assert!(other.contains("another config"), "{other}");
    }
}
