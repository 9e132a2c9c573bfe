use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use crate::Scratch;

/// The files of one result, which together replace those of an older result.
///
/// They are written into a folder inside the target. If anything fails before [`Staged::commit`], the target's own
/// files are as they were. Files that a killed process left are removed when the next result is staged.
#[derive(Debug)]
pub struct Staged {
    target: PathBuf,
    folder: Scratch,
}

impl Staged {
    /// Creates the folder for a result that is to appear in `target`. The target is created if it is missing.
    ///
    /// # Errors
    /// Returns the error of the file system.
    pub fn new(target: &Path) -> io::Result<Self> {
        fs::create_dir_all(target)?;
        // The folder lies inside the target, because the parent may be on another file system or not accessible to
        // this user.
        Ok(Self { target: target.into(), folder: Scratch::new(target, "staged")? })
    }

    /// Returns the folder into which the files must be written.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Moves every file into the target. `marker` names the file whose presence shows that the result is complete.
    /// The old marker is removed first, and the new one is moved last, so a process that is killed in between leaves
    /// no marker. `stale` names files of an older result that are removed if this result has no file of that name.
    /// All other files in the target remain.
    ///
    /// # Errors
    /// Returns the error of the file system.
    pub fn commit(self, marker: &str, stale: &[&str]) -> io::Result<()> {
        let mut names = Vec::new();
        for entry in fs::read_dir(self.path())? {
            names.push(entry?.file_name());
        }
        // A file cannot replace a folder. This is checked before anything is moved.
        if let Some(name) = names.iter().find(|name| self.target.join(name).is_dir()) {
            let place = self.target.join(name);
            return Err(io::Error::new(io::ErrorKind::IsADirectory, format!("{} is a folder", place.display())));
        }
        names.sort_by_key(|name| name == marker);
        remove(&self.target.join(marker))?;
        for name in &names {
            fs::rename(self.path().join(name), self.target.join(name))?;
        }
        for name in stale.iter().filter(|name| !names.iter().any(|new| new == **name)) {
            remove(&self.target.join(name))?;
        }
        Ok(())
    }
}

/// Removes a file that may be missing.
fn remove(path: &Path) -> io::Result<()> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn content(folder: &Path) -> Vec<(String, String)> {
        let mut files: Vec<_> = fs::read_dir(folder)
            .unwrap()
            .map(|entry| {
                let path = entry.unwrap().path();
                let name = path.file_name().unwrap().to_string_lossy().into_owned();
                (name, fs::read_to_string(path).unwrap_or_default())
            })
            .collect();
        files.sort();
        files
    }

    fn pairs(list: &[(&str, &str)]) -> Vec<(String, String)> {
        list.iter().map(|(name, text)| ((*name).to_owned(), (*text).to_owned())).collect()
    }

    fn old(folder: &Path) {
        for name in ["model.json", "model-refined.json", "result.json", "notes.txt"] {
            fs::write(folder.join(name), "old").unwrap();
        }
    }

    #[test]
    fn the_new_result_replaces_the_old_one_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        old(folder.path());
        let staged = Staged::new(folder.path()).unwrap();
        for name in ["model.json", "result.json", "frf.svg"] {
            fs::write(staged.path().join(name), "new").unwrap();
        }
        staged.commit("result.json", &["model-refined.json", "model.json"]).unwrap();
        let expected = [("frf.svg", "new"), ("model.json", "new"), ("notes.txt", "old"), ("result.json", "new")];
        assert_eq!(content(folder.path()), pairs(&expected));
    }

    #[test]
    fn a_result_that_is_not_committed_leaves_the_old_one() {
        let folder = tempfile::tempdir().unwrap();
        old(folder.path());
        let before = content(folder.path());
        let staged = Staged::new(folder.path()).unwrap();
        fs::write(staged.path().join("model.json"), "new").unwrap();
        drop(staged);
        assert_eq!(content(folder.path()), before);
        // Nor does a result with a file that cannot be moved.
        fs::create_dir(folder.path().join("report.html")).unwrap();
        let staged = Staged::new(folder.path()).unwrap();
        for name in ["model.json", "report.html", "result.json"] {
            fs::write(staged.path().join(name), "new").unwrap();
        }
        let said = staged.commit("result.json", &[]).unwrap_err().to_string();
        assert!(said.contains("report.html is a folder"), "{said}");
        fs::remove_dir(folder.path().join("report.html")).unwrap();
        assert_eq!(content(folder.path()), before);
    }

    #[test]
    fn what_a_killed_process_staged_is_removed() {
        let folder = tempfile::tempdir().unwrap();
        let left = folder.path().join(".staged.x.plid-tmp");
        fs::create_dir(&left).unwrap();
        fs::write(left.join("model.json"), "half").unwrap();
        let living = Staged::new(folder.path()).unwrap();
        assert!(!left.exists());
        let other = Staged::new(folder.path()).unwrap();
        assert!(living.path().exists() && other.path().exists());
    }
}
