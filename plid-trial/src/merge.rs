//! Merges shards, each of which must be present exactly once.

use plid_file::{Folders, sha256};
use plid_work::{SHARD, require_whole, shard_folders};
use std::fs;
use std::path::{Path, PathBuf};

use crate::answer;
use crate::diagnose::{ANSWERS, ShardFile};
use crate::error::TrialError;
use crate::files;
use crate::manifest::{MANIFEST, Manifest};

/// Merges the answers of shards into T/answers. Without `folders`, all shards in T/shards are merged.
///
/// # Errors
/// Returns [`TrialError::Shards`] with the number of a shard that is missing, unfinished or present twice, or an error
/// for an answer that has changed.
pub fn merge(trial: &Path, folders: &[PathBuf]) -> Result<usize, TrialError> {
    let manifest = Manifest::read(trial)?;
    let hash = sha256(&files::read(&trial.join(MANIFEST))?);
    let folders = match folders {
        [] => shard_folders(trial).map_err(TrialError::file(trial))?,
        given => given.to_vec(),
    };
    let mut found = Vec::new();
    let mut answered = Vec::new();
    let mut one = None;
    for folder in folders {
        let path = folder.join(SHARD);
        if !path.exists() {
            let shown = folder.display();
            return Err(TrialError::Shards(format!("{shown}: this shard is not finished; run its `diagnose` again")));
        }
        let ShardFile { shard, trial_sha256, program, cases } = files::parse(&path, &files::read(&path)?)?;
        if trial_sha256 != hash {
            return Err(TrialError::Shards(format!("{shard} is of another trial")));
        }
        let ours = one.get_or_insert_with(|| program.clone());
        if *ours != program {
            return Err(TrialError::OtherProgram {
                what: shard.to_string(),
                theirs: Box::new(program),
                ours: Box::new(ours.clone()),
                running: false,
            });
        }
        let theirs = manifest.cases.iter().enumerate().filter(|(index, _)| shard.has(*index));
        if theirs.map(|(_, case)| &case.case).ne(&cases) {
            return Err(TrialError::Shards(format!("{shard} does not hold the cases of its number")));
        }
        found.push((shard, folder.clone()));
        answered.push((folder, cases));
    }
    let of = require_whole(&found).map_err(TrialError::Shards)?;
    copy_all(&trial.join(ANSWERS), &answered)?;
    Ok(of)
}

/// Copies the answers of all shards that are not merged yet. Existing answers must be the same.
fn copy_all(answers: &Path, shards: &[(PathBuf, Vec<String>)]) -> Result<(), TrialError> {
    let merged = Folders::new(answers).map_err(TrialError::file(answers))?;
    for (folder, cases) in shards {
        for case in cases {
            let Some((_, theirs)) = answer::read(folder, case)? else {
                let shown = folder.display();
                return Err(TrialError::Shards(format!("{shown}: the answer to {case} is missing")));
            };
            match answer::read(answers, case)? {
                None => copy(&folder.join(case), &merged, case)?,
                Some((_, ours)) if ours == theirs => {}
                Some(_) => {
                    return Err(TrialError::Changed { case: case.clone(), since: "it was merged before" });
                }
            }
        }
    }
    Ok(())
}

/// Copies a whole folder of plain files.
fn copy(from: &Path, merged: &Folders, case: &str) -> Result<(), TrialError> {
    let mut content = Vec::new();
    for entry in fs::read_dir(from).map_err(TrialError::file(from))? {
        let path = entry.map_err(TrialError::file(from))?.path();
        let Some(name) = path.file_name().and_then(|name| name.to_str()) else { continue };
        content.push((name.to_owned(), files::read(&path)?));
    }
    let written = merged.write(case, content.iter().map(|(name, bytes)| (name.as_str(), bytes.as_slice())));
    written.map_err(TrialError::file(merged.path().join(case)))
}
