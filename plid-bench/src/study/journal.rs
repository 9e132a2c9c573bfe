use std::collections::BTreeMap;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use plid_file::{sha256, to_line};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::{StudyError, write};

/// The finished cells of a study, saved as they are completed in DIR/cells.jsonl: a head followed by one line per cell.
///
/// A crash loses no more than the line that was being written.
#[derive(Debug)]
pub struct Journal<T> {
    path: PathBuf,
    file: File,
    cells: BTreeMap<String, T>,
}

/// The first line.
#[derive(PartialEq, Serialize, Deserialize)]
struct Head {
    study: String,
    config_sha256: String,
}

#[derive(Serialize)]
struct Line<'a, T> {
    key: &'a str,
    cell: &'a T,
}

#[derive(Deserialize)]
struct OwnedLine<T> {
    key: String,
    cell: T,
}

/// The journal's name in the output directory.
const NAME: &str = "cells.jsonl";

impl<T: Serialize + DeserializeOwned> Journal<T> {
    /// Opens the journal of `study` in `directory`, which is created if it is missing. With `resume`, the existing
    /// cells are kept. Without it, or if there are none, the journal starts empty. `config` is a text of everything
    /// on which the cells depend, which is the config, and for a study of time also the machine.
    ///
    /// # Errors
    /// Returns an error for a journal of another study or config, or for one with a line that is not a cell. An
    /// incomplete last line is dropped instead. Also returns the errors of the file system.
    pub fn open(directory: &Path, study: &str, config: &str, resume: bool) -> Result<Self, StudyError> {
        let path = directory.join(NAME);
        let head = Head { study: study.into(), config_sha256: sha256(config) };
        fs::create_dir_all(directory).map_err(StudyError::file(directory))?;
        let old = match fs::read(&path) {
            Ok(bytes) if resume => bytes,
            Err(source) if source.kind() != io::ErrorKind::NotFound => return Err(StudyError::File { path, source }),
            _ => Vec::new(),
        };
        let whole = old.iter().rposition(|&byte| byte == b'\n').map_or(0, |end| end + 1);
        let cells = cells(&path, &head, &old[..whole])?;
        let head = line(&path, &head)?;
        let file = open_at(&path, whole, &head).map_err(StudyError::file(&path))?;
        Ok(Self { path, file, cells })
    }

    /// Writes the journal of `study` with these cells to `directory`, and replaces an existing one.
    ///
    /// # Errors
    /// Returns [`StudyError::NotFinite`] or [`StudyError::File`].
    ///
    /// # Panics
    /// Panics if the type cannot be represented in JSON, which is a fault of the type and not of its value.
    pub fn replace(directory: &Path, study: &str, config: &str, cells: &BTreeMap<String, T>) -> Result<(), StudyError> {
        let head = Head { study: study.into(), config_sha256: sha256(config) };
        let path = directory.join(NAME);
        let mut text = line(&path, &head)?;
        for (key, cell) in cells {
            text += &line(&path, &Line { key, cell })?;
        }
        write(&path, text)
    }

    /// Appends a finished cell, which replaces an earlier one with the same key.
    ///
    /// # Errors
    /// Returns [`StudyError::NotFinite`], because such a cell could not be read back, or [`StudyError::File`].
    ///
    /// # Panics
    /// Panics if the type cannot be represented in JSON, which is a fault of the type and not of its value.
    pub fn append(&mut self, key: &str, cell: T) -> Result<(), StudyError> {
        let line = line(&self.path, &Line { key, cell: &cell })?;
        // A single write, so that only the last line can be incomplete.
        self.file.write_all(line.as_bytes()).and_then(|()| self.file.flush()).map_err(StudyError::file(&self.path))?;
        self.cells.insert(key.into(), cell);
        Ok(())
    }

    /// Returns a finished cell.
    pub fn get(&self, key: &str) -> Option<&T> {
        self.cells.get(key)
    }

    /// Returns all finished cells by key.
    pub fn cells(&self) -> &BTreeMap<String, T> {
        &self.cells
    }

    /// Returns the error for an interruption by the user.
    pub fn interrupted(&self) -> StudyError {
        StudyError::Interrupted { journal: self.path.clone() }
    }
}

/// Parses the cells of a journal with complete lines; the result is empty for an empty journal.
fn cells<T: DeserializeOwned>(path: &Path, head: &Head, bytes: &[u8]) -> Result<BTreeMap<String, T>, StudyError> {
    let bad = |line: usize, reason: String| StudyError::Content { path: path.into(), line, reason };
    let text = std::str::from_utf8(bytes).map_err(|error| bad(1, error.to_string()))?;
    let mut lines = text.lines().zip(1..);
    if let Some((line, number)) = lines.next() {
        let found: Head = serde_json::from_str(line).map_err(|_| bad(number, "not the journal of a study".into()))?;
        if found.study != head.study {
            return Err(bad(number, format!("the journal of another study, {}", found.study)));
        }
        if found != *head {
            return Err(bad(
                number,
                "the cells belong to another config or machine; use --force instead of --resume to start again".into(),
            ));
        }
    }
    lines
        .map(|(line, number)| {
            let line: OwnedLine<T> =
                serde_json::from_str(line).map_err(|error| bad(number, format!("not a cell: {error}")))?;
            Ok((line.key, line.cell))
        })
        .collect()
}

/// Returns a line of the journal at `path`.
fn line(path: &Path, content: &impl Serialize) -> Result<String, StudyError> {
    to_line(content).map_err(StudyError::not_finite(path))
}

/// Opens the file, truncated to its first `whole` bytes, for appending.
fn open_at(path: &Path, whole: usize, head: &str) -> io::Result<File> {
    let file = OpenOptions::new().create(true).append(true).open(path)?;
    file.set_len(whole as u64)?;
    if whole == 0 {
        (&file).write_all(head.as_bytes())?;
    }
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn open(directory: &Path, config: &str, resume: bool) -> Result<Journal<f64>, StudyError> {
        Journal::open(directory, "test", config, resume)
    }

    #[test]
    fn what_was_done_is_taken_over_and_a_torn_line_is_dropped() {
        let directory = tempfile::tempdir().unwrap();
        let at = directory.path();
        let mut journal = open(at, "config", false).unwrap();
        journal.append("a", 1.5).unwrap();
        journal.append("b", 2.5).unwrap();
        let whole = fs::read_to_string(at.join(NAME)).unwrap();
        // The last line is incomplete.
        fs::write(at.join(NAME), &whole[..whole.len() - 4]).unwrap();
        let mut journal = open(at, "config", true).unwrap();
        assert_eq!(journal.get("a"), Some(&1.5));
        assert_eq!(journal.get("b"), None);
        journal.append("b", 2.5).unwrap();
        assert_eq!(fs::read_to_string(at.join(NAME)).unwrap(), whole);
        assert_eq!(open(at, "config", true).unwrap().cells().len(), 2);
        // A truncated head does not count as a head.
        fs::write(at.join(NAME), "{\"study\"").unwrap();
        assert!(open(at, "config", true).unwrap().cells().is_empty());
        // Without `resume`, the old cells are removed.
        fs::write(at.join(NAME), &whole).unwrap();
        assert!(open(at, "config", false).unwrap().cells().is_empty());
        assert!(open(at, "config", true).unwrap().cells().is_empty());
    }

    #[test]
    fn a_cell_that_is_not_finite_is_refused_and_not_written() {
        let directory = tempfile::tempdir().unwrap();
        let at = directory.path();
        let mut journal = open(at, "config", false).unwrap();
        journal.append("a", 1.0).unwrap();
        let before = fs::read_to_string(at.join(NAME)).unwrap();
        let refused = journal.append("b", f64::NAN).unwrap_err().to_string();
        assert!(refused.contains("cells.jsonl: `cell` is NaN"), "{refused}");
        let cells = BTreeMap::from([("a".to_owned(), 1.0), ("b".to_owned(), f64::INFINITY)]);
        let refused = Journal::replace(at, "test", "config", &cells).unwrap_err().to_string();
        assert!(refused.contains("cells.jsonl: `cell` is inf"), "{refused}");
        assert_eq!(fs::read_to_string(at.join(NAME)).unwrap(), before);
    }

    #[test]
    fn what_does_not_belong_is_refused_by_name_and_line() {
        let directory = tempfile::tempdir().unwrap();
        let at = directory.path();
        open(at, "config", false).unwrap().append("a", 1.0).unwrap();
        let good = fs::read_to_string(at.join(NAME)).unwrap();
        let message = open(at, "other", true).unwrap_err().to_string();
        assert!(message.contains("cells.jsonl, line 1") && message.contains("another config"), "{message}");
        let message = Journal::<f64>::open(at, "speed", "config", true).unwrap_err().to_string();
        assert!(message.contains("another study, test"), "{message}");
        fs::write(at.join(NAME), format!("{good}nonsense\n{{}}\n")).unwrap();
        let message = open(at, "config", true).unwrap_err().to_string();
        assert!(message.contains("line 3: not a cell"), "{message}");
        // A refusal changes nothing.
        assert!(fs::read_to_string(at.join(NAME)).unwrap().contains("nonsense"));
    }
}
