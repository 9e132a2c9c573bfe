use std::ffi::OsStr;
use std::io;
use std::path::{Path, PathBuf};

use tempfile::{Builder, TempDir};

use crate::leftover::{Lock, SUFFIX, claim, clear, prefix};

/// A temporary folder, which is removed when this value is dropped.
///
/// It is locked during the lifetime of this value. A process that is killed leaves its folder behind. The next
/// process that creates a folder of the same name in the same place removes it.
#[derive(Debug)]
pub struct Scratch {
    folder: TempDir,
    /// The lock, which is released after the folder is removed.
    _lock: Lock,
}

impl Scratch {
    /// Creates a temporary folder in `parent`, and removes those of this name that belong to no running process.
    /// `name` describes the purpose of the folders and is a part of their names.
    ///
    /// # Errors
    /// Returns the error of the file system.
    pub fn new(parent: &Path, name: impl AsRef<OsStr>) -> io::Result<Self> {
        let name = name.as_ref();
        clear(parent, name);
        Self::unsearched(parent, name)
    }

    /// Creates a temporary folder in `parent` without a search for those that killed processes left there.
    pub(crate) fn unsearched(parent: &Path, name: &OsStr) -> io::Result<Self> {
        loop {
            let folder = Builder::new().prefix(&prefix(name)).suffix(SUFFIX).tempdir_in(parent)?;
            if let Some(lock) = claim(folder.path())? {
                return Ok(Self { folder, _lock: lock });
            }
        }
    }

    /// Returns the path of the folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Keeps the folder when this value is dropped, and returns its path.
    pub(crate) fn keep(self) -> PathBuf {
        self.folder.keep()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn folders_of_killed_processes_are_removed_and_those_in_use_kept() {
        let parent = tempfile::tempdir().unwrap();
        let living = Scratch::new(parent.path(), "work").unwrap();
        fs::write(living.path().join("file"), "used").unwrap();
        // As after a process was killed: the folder remains, and the lock is released.
        let left = Scratch::new(parent.path(), "work").unwrap().keep();
        fs::write(left.join("file"), "unused").unwrap();
        let another = parent.path().join(".another.x.plid-tmp");
        fs::create_dir(&another).unwrap();

        let next = Scratch::new(parent.path(), "work").unwrap();
        assert!(!left.exists() && next.path().exists() && another.exists());
        assert_eq!(fs::read(living.path().join("file")).unwrap(), b"used");
        let paths = [living.path(), next.path()].map(Path::to_owned);
        drop((living, next));
        assert!(paths.iter().all(|path| !path.exists()));
    }

    /// Anybody may put such entries into a folder of the system that all users share.
    #[cfg(unix)]
    #[test]
    fn neither_a_pipe_nor_a_link_is_followed() {
        let parent = tempfile::tempdir().unwrap();
        let at = |name: &str| parent.path().join(name);
        fs::create_dir(at("elsewhere")).unwrap();
        std::os::unix::fs::symlink(at("elsewhere"), at(".work.link.plid-tmp")).unwrap();
        assert!(std::process::Command::new("mkfifo").arg(at(".work.pipe.plid-tmp")).status().unwrap().success());
        Scratch::new(parent.path(), "work").unwrap();
        assert!(at("elsewhere").exists() && at(".work.pipe.plid-tmp").exists());
    }
}
