//! Temporary files and folders of processes that were killed.
//!
//! Whoever makes a temporary entry holds a lock on it, which the system releases when the process ends. An entry that
//! can be locked therefore belongs to no running process.

use std::ffi::OsStr;
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::Path;

/// How the name of a temporary entry ends.
pub(crate) const SUFFIX: &str = ".plid-tmp";

/// How the name of a temporary entry for `name` begins.
pub(crate) fn prefix(name: &OsStr) -> String {
    format!(".{}.", name.to_string_lossy())
}

/// The lock of a temporary entry, which is held until this value is dropped.
#[derive(Debug)]
pub(crate) struct Lock {
    /// `None` where the system does not open folders.
    _file: Option<File>,
}

/// Takes the lock of a new temporary entry. Returns `None` if another process took the entry for a leftover before the
/// lock was held and has removed it.
///
/// # Errors
/// Returns the error of the file system if the entry is there and cannot be opened.
pub(crate) fn claim(path: &Path) -> io::Result<Option<Lock>> {
    let file = match File::open(path) {
        Ok(file) => Some(file),
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        // Windows does not open folders, so that none is ever taken for a leftover there.
        Err(_) if cfg!(windows) && path.is_dir() => None,
        Err(error) => return Err(error),
    };
    if let Some(file) = &file {
        // A file system without locks also has no other process that could take one.
        let _ = file.lock();
    }
    Ok(path.exists().then_some(Lock { _file: file }))
}

/// Removes the temporary entries for `name` in `folder` that belong to no process. Errors are ignored, because
/// a leftover is only untidy.
pub(crate) fn clear(folder: &Path, name: &OsStr) {
    remove(folder, &prefix(name));
}

/// Removes all temporary entries in `folder` that belong to no process, whatever they are for.
pub(crate) fn clear_all(folder: &Path) {
    remove(folder, ".");
}

/// Removes the temporary entries whose names begin with `prefix`.
fn remove(folder: &Path, prefix: &str) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        let found = entry.file_name();
        let found = found.to_string_lossy();
        // A pipe of this name, which anybody may put into a shared folder, would have no end when it is opened.
        let own = entry.file_type().is_ok_and(|kind| kind.is_dir() || kind.is_file());
        if !own || !found.starts_with(prefix) || !found.ends_with(SUFFIX) {
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
