//! Temporary files and folders of processes that were killed.
//!
//! Whoever makes a temporary entry holds a lock on it, which the system releases when the process ends. An entry that
//! can be locked therefore belongs to nobody.

use std::ffi::OsStr;
use std::fs::{self, File, TryLockError};
use std::path::Path;

/// How the name of a temporary entry ends.
pub(crate) const SUFFIX: &str = ".plid-tmp";

/// How the name of a temporary entry for `name` begins.
pub(crate) fn prefix(name: &OsStr) -> String {
    format!(".{}.", name.to_string_lossy())
}

/// Takes the lock of a new temporary entry. It is held until the returned file is closed. `None` if another process
/// took the entry for a leftover before the lock was held and has removed it.
pub(crate) fn claim(path: &Path) -> Option<File> {
    let file = File::open(path).ok()?;
    // A file system without locks also has no other process that could take one.
    let _ = file.lock();
    path.exists().then_some(file)
}

/// Removes the temporary entries for `name` in `folder` that belong to no process. Errors are ignored, because
/// a leftover is only untidy.
pub(crate) fn clear(folder: &Path, name: &OsStr) {
    let prefix = prefix(name);
    let Ok(entries) = fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        let found = entry.file_name();
        let found = found.to_string_lossy();
        if !found.starts_with(&prefix) || !found.ends_with(SUFFIX) {
            continue;
        }
        let path = entry.path();
        let Ok(file) = File::open(&path) else { continue };
        match file.try_lock() {
            Ok(()) if path.is_dir() => drop(fs::remove_dir_all(&path)),
            Ok(()) => drop(fs::remove_file(&path)),
            Err(TryLockError::WouldBlock | TryLockError::Error(_)) => {}
        }
    }
}
