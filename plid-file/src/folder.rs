use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use crate::Scratch;
use crate::leftover::clear_all;

/// A folder of folders, each of which is written completely or not at all.
///
/// The search for leftovers of killed processes takes place once, when this value is created. The time to write one
/// folder therefore does not grow with the number of existing folders.
#[derive(Debug)]
pub struct Folders {
    parent: PathBuf,
}

impl Folders {
    /// Creates the folder `parent` if it is missing, and removes the temporary files and folders in it that belong to
    /// no running process.
    ///
    /// # Errors
    /// Returns the error of the file system.
    pub fn new(parent: impl Into<PathBuf>) -> io::Result<Self> {
        let parent = parent.into();
        fs::create_dir_all(&parent)?;
        clear_all(&parent);
        Ok(Self { parent })
    }

    /// Returns the path of the folder that holds the others.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.parent
    }

    /// Writes a new folder with these files completely or not at all. If several processes do so at the same time,
    /// one of them succeeds.
    ///
    /// # Errors
    /// Returns [`io::ErrorKind::AlreadyExists`] if the folder exists, or the error of the file system.
    pub fn write<'a>(&self, name: &str, files: impl IntoIterator<Item = (&'a str, &'a [u8])>) -> io::Result<()> {
        let place = self.parent.join(name);
        if place.parent() != Some(&self.parent) || place.file_name().is_none() {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, format!("{name:?} names no folder")));
        }
        let beside = Scratch::unsearched(&self.parent, name.as_ref())?;
        for (name, bytes) in files {
            let mut file = File::create(beside.path().join(name))?;
            file.write_all(bytes)?;
            file.sync_all()?;
        }
        fs::rename(beside.path(), place).map_err(|error| match error.kind() {
            io::ErrorKind::DirectoryNotEmpty => io::ErrorKind::AlreadyExists.into(),
            _ => error,
        })?;
        // It has another name now, and nothing is left to remove.
        beside.keep();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_written_once() {
        let parent = tempfile::tempdir().unwrap();
        let folders = Folders::new(parent.path().join("new")).unwrap();
        folders.write("case", [("a", &b"1"[..]), ("b", b"2")]).unwrap();
        let again = folders.write("case", [("a", &b"3"[..])]).unwrap_err();
        assert_eq!(again.kind(), io::ErrorKind::AlreadyExists);
        assert_eq!(fs::read(folders.path().join("case/a")).unwrap(), b"1");
        assert_eq!(fs::read_dir(folders.path()).unwrap().count(), 1, "nothing else is left");
        for name in ["", "..", "/", "case/below", "/elsewhere"] {
            assert_eq!(folders.write(name, []).unwrap_err().kind(), io::ErrorKind::InvalidInput, "{name:?}");
        }
    }

    #[test]
    fn leftovers_are_searched_for_once() {
        let parent = tempfile::tempdir().unwrap();
        let left = |name: &str| {
            let place = parent.path().join(name);
            fs::create_dir(&place).unwrap();
            place
        };
        let [one, other] = [left(".case.x1.plid-tmp"), left(".elsewhere.x1.plid-tmp")];
        let living = Scratch::new(parent.path(), "case").unwrap();
        fs::create_dir(parent.path().join("whole")).unwrap();
        let folders = Folders::new(parent.path()).unwrap();
        assert!(!one.exists() && !other.exists() && living.path().exists());
        let later = left(".case.x2.plid-tmp");
        folders.write("case", [("a", &b"1"[..])]).unwrap();
        assert!(later.exists() && parent.path().join("whole").exists());
    }
}
