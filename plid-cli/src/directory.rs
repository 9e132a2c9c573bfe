//! The directory for the results.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use plid::lab::report::file_name;

use super::Failure;
use super::part::Part;

/// The output directory of work that can be interrupted, and the content that it may already have.
#[derive(clap::Args)]
pub struct Output {
    /// Output directory [default: out/NAME; a study's name is bench-STUDY].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Continue interrupted work in the output directory, without repeating finished parts.
    #[arg(long)]
    pub resume: bool,
    /// Write into a directory that is not empty.
    #[arg(long)]
    pub force: bool,
}

impl Output {
    /// Returns the directory for work of this name. It is new or empty, or an option allows writing to it.
    ///
    /// # Errors
    /// Returns an input failure if the directory is not empty and neither option allows this.
    pub fn directory(&self, name: &str) -> Result<PathBuf, Failure> {
        self.directory_of(name, &Part::default(), "")
    }

    /// Returns the directory for a part of the work. All parts share one directory; the folder `parts` marks it.
    ///
    /// # Errors
    /// Returns the errors of [`Output::directory`].
    pub fn directory_of(&self, name: &str, part: &Part, parts: &str) -> Result<PathBuf, Failure> {
        let out = self.out.clone().unwrap_or_else(|| default_for(name));
        check(&out, self.force || self.resume || (part.is_one_of_several() && out.join(parts).is_dir()))?;
        Ok(out)
    }

    /// Whether finished work is kept. It is kept at the user's request, in a merge, and in a shard, because a queue
    /// may restart a shard.
    pub fn keeps(&self, part: &Part) -> bool {
        self.resume || part.merge || (part.shard.is_some() && !self.force)
    }
}

/// Returns `out/NAME`. The result lies in `out` whatever the name is.
pub fn default_for(name: &str) -> PathBuf {
    Path::new("out").join(file_name(if name.is_empty() { "experiment" } else { name }))
}

/// Checks that an output directory is new or empty, unless the user allows an existing one. It must be a directory in
/// any case.
pub fn check(directory: &Path, old_is_allowed: bool) -> Result<(), Failure> {
    if is_free(directory)? || old_is_allowed {
        return Ok(());
    }
    Err(Failure::input(format!(
        "{} exists and is not empty; name another --out, or give --force to write into it",
        directory.display()
    )))
}

/// Whether a directory is new or empty.
pub fn is_free(directory: &Path) -> Result<bool, Failure> {
    match fs::read_dir(directory) {
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(true),
        Err(error) => Err(Failure::file(directory, &error)),
        Ok(mut entries) => Ok(entries.next().is_none()),
    }
}

/// Carries out work that writes into `directory`. The directory is created first, so that a location that cannot be
/// written to is found before the work and not after it. If the work fails before writing anything, a new directory
/// is removed.
pub fn with<T>(directory: &Path, work: impl FnOnce() -> Result<T, Failure>) -> Result<T, Failure> {
    let is_new = !directory.exists();
    fs::create_dir_all(directory).map_err(|error| Failure::file(directory, &error))?;
    let result = work();
    if result.is_err() && is_new {
        // This removes only an empty directory, so a checkpoint remains.
        let _ = fs::remove_dir(directory);
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_cannot_lead_elsewhere() {
        for (name, directory) in [
            ("truss 30", "out/truss 30"),
            ("/etc", "out/%2Fetc"),
            ("../../x", "out/%2E.%2F..%2Fx"),
            ("..", "out/%2E%2E"),
            ("", "out/experiment"),
        ] {
            assert_eq!(default_for(name), Path::new(directory));
        }
    }
}
