//! Merges shards, each of which must be present exactly once.

use plid_file::{sha256, write_folder};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::answer::{self, Shard};
use crate::diagnose::{ANSWERS, SHARD, SHARDS, ShardFile};
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
    let found = if folders.is_empty() { list(&trial.join(SHARDS))? } else { folders.to_vec() };
    let mut shards: BTreeMap<usize, (PathBuf, Vec<String>)> = BTreeMap::new();
    let mut of = None;
    let mut one = None;
    for folder in found {
        let path = folder.join(SHARD);
        if !path.exists() {
            let shown = folder.display();
            return Err(TrialError::Shards(format!("{shown}: this shard is not finished; run its `diagnose` again")));
        }
        let ShardFile { shard, trial_sha256, program, cases } = files::parse(&path, &files::read(&path)?)?;
        let Shard { number, of: all } = shard;
        if trial_sha256 != hash {
            return Err(TrialError::Shards(format!("shard {number} of {all} is of another trial")));
        }
        let ours = one.get_or_insert_with(|| program.clone());
        if *ours != program {
            return Err(TrialError::OtherProgram {
                what: format!("shard {number} of {all}"),
                theirs: Box::new(program),
                ours: Box::new(ours.clone()),
                running: false,
            });
        }
        if *of.get_or_insert(all) != all {
            let other = of.unwrap_or(all);
            return Err(TrialError::Shards(format!("shard {number} is one of {all}, but others are of {other}")));
        }
        let theirs = manifest.cases.iter().enumerate().filter(|(index, _)| shard.has(*index));
        if theirs.map(|(_, case)| &case.case).ne(&cases) {
            return Err(TrialError::Shards(format!("shard {number} of {all} does not hold the cases of its number")));
        }
        if let Some((first, _)) = shards.insert(number, (folder.clone(), cases)) {
            let (a, b) = (first.display().to_string(), folder.display().to_string());
            return Err(TrialError::Shards(format!("shard {number} of {all} is there twice: {a} and {b}")));
        }
    }
    let Some(of) = of else { return Err(TrialError::Shards("there is no shard to merge".to_owned())) };
    let missing: Vec<String> = (1..=of).filter(|i| !shards.contains_key(i)).map(|i| i.to_string()).collect();
    if !missing.is_empty() {
        let (word, verb) = if missing.len() == 1 { ("shard", "is") } else { ("shards", "are") };
        return Err(TrialError::Shards(format!("{word} {} of {of} {verb} missing", missing.join(", "))));
    }

    copy_all(&trial.join(ANSWERS), shards.values())?;
    Ok(of)
}

/// Copies the answers of all shards that are not there yet; those that are there must be the same.
fn copy_all<'a>(answers: &Path, shards: impl Iterator<Item = &'a (PathBuf, Vec<String>)>) -> Result<(), TrialError> {
    files::make(answers)?;
    for (folder, cases) in shards {
        for case in cases {
            let Some((_, theirs)) = answer::read(folder, case)? else {
                let shown = folder.display();
                return Err(TrialError::Shards(format!("{shown}: the answer to {case} is missing")));
            };
            match answer::read(answers, case)? {
                None => copy(&folder.join(case), answers, case)?,
                Some((_, ours)) if ours == theirs => {}
                Some(_) => {
                    return Err(TrialError::Changed { case: case.clone(), since: "it was merged before" });
                }
            }
        }
    }
    Ok(())
}

fn list(directory: &Path) -> Result<Vec<PathBuf>, TrialError> {
    let mut found = Vec::new();
    let entries = match fs::read_dir(directory) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(found),
        entries => entries.map_err(TrialError::file(directory))?,
    };
    for entry in entries {
        let path = entry.map_err(TrialError::file(directory))?.path();
        if path.is_dir() {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

/// Copies a folder of plain files, whole.
fn copy(from: &Path, answers: &Path, case: &str) -> Result<(), TrialError> {
    let mut content = Vec::new();
    for entry in fs::read_dir(from).map_err(TrialError::file(from))? {
        let path = entry.map_err(TrialError::file(from))?.path();
        let Some(name) = path.file_name().and_then(|name| name.to_str()) else { continue };
        content.push((name.to_owned(), files::read(&path)?));
    }
    let place = answers.join(case);
    let written = write_folder(&place, content.iter().map(|(name, bytes)| (name.as_str(), bytes.as_slice())));
    written.map_err(TrialError::file(place))
}
