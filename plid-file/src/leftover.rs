//! Temporary files and folders of processes that were killed.
//!
//! The process that creates a temporary entry holds a lock on it, which the system releases when the process ends. An
//! entry that can be locked therefore belongs to no running process.

use std::ffi::OsStr;
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::Path;

/// The end of the name of a temporary entry.
pub(crate) const SUFFIX: &str = ".plid-tmp";

/// Returns the beginning of the name of a temporary entry for `name`.
pub(crate) fn prefix(name: &OsStr) -> String {
    format!(".{}.", name.to_string_lossy())
}

/// The lock of a temporary entry, which is held until this value is dropped.
#[derive(Debug)]
pub(crate) struct Lock {
    /// `None` if the system cannot open folders.
    _file: Option<File>,
}

/// Locks a new temporary entry. Returns `None` if another process mistook the entry for a leftover and removed it
/// before it was locked.
///
/// # Errors
/// Returns the error of the file system if the entry exists but cannot be opened.
pub(crate) fn claim(path: &Path) -> io::Result<Option<Lock>> {
    let file = match File::open(path) {
        Ok(file) => Some(file),
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        // Windows cannot open folders, so no folder is ever removed as a leftover there.
        Err(_) if cfg!(windows) && path.is_dir() => None,
        Err(error) => return Err(error),
    };
    if let Some(file) = &file {
        // On a file system without locks, no other process can lock the entry either.
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
        // Anybody may put a pipe of this name into a shared folder. Opening it would block.
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
