//! The folders of the runs that a merge carries out itself.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use plid_file::file_name;

use crate::run::RESULT;

/// The folder of the runs of a finished merge.
pub(super) const RUNS: &str = "runs";

/// The folder of the runs of a merge that is to replace a finished one.
const NEW: &str = "runs.new";

/// Returns the folder for the runs of a merge in `directory`. A finished merge keeps its own runs until
/// [`replace_runs`]. `is_own` states that the finished merge is the same one, whose runs need not be repeated. With
/// `resume`, the runs that were to replace a finished merge are continued; otherwise they are removed.
pub(super) fn folder(directory: &Path, is_own: bool, resume: bool) -> io::Result<PathBuf> {
    let new = directory.join(NEW);
    let replaces = directory.join(RESULT).exists() && !is_own;
    if !(replaces && resume) && new.exists() {
        fs::remove_dir_all(&new)?;
    }
    Ok(if replaces { new } else { directory.join(RUNS) })
}

/// Returns the folder of one run. It lies in the folder of the runs whatever the name of its input.
pub(super) fn of_input(runs: &Path, input: &str) -> PathBuf {
    runs.join(file_name(input))
}

/// Replaces the old runs by new ones, if there are any. The result of the old merge is removed first, because it does
/// not belong to the new runs.
pub(super) fn replace_runs(directory: &Path) -> io::Result<()> {
    let (new, runs) = (directory.join(NEW), directory.join(RUNS));
    if !new.exists() {
        return Ok(());
    }
    for removed in [fs::remove_file(directory.join(RESULT)), fs::remove_dir_all(&runs)] {
        match removed {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
    }
    fs::rename(new, runs)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_finished_merge_keeps_its_runs_until_the_new_ones_are_complete() {
        let at = tempfile::tempdir().unwrap();
        let directory = at.path();
        let run = |runs: &Path, text: &str| {
            let run = of_input(runs, "../u1");
            fs::create_dir_all(&run).unwrap();
            fs::write(run.join("model.json"), text).unwrap();
        };
        let first = folder(directory, false, false).unwrap();
        assert_eq!(first, directory.join("runs"));
        run(&first, "old");
        replace_runs(directory).unwrap();
        fs::write(directory.join(RESULT), "old").unwrap();
        run(&folder(directory, false, false).unwrap(), "killed");
        assert_eq!(folder(directory, true, true).unwrap(), first);
        let second = folder(directory, false, false).unwrap();
        assert!(!second.exists());
        run(&second, "new");
        assert_eq!(folder(directory, false, true).unwrap(), second);
        let old = first.join("%2E.%2Fu1/model.json");
        assert_eq!(fs::read_to_string(&old).unwrap(), "old");
        replace_runs(directory).unwrap();
        assert_eq!(fs::read_to_string(&old).unwrap(), "new");
        assert!(!second.exists() && !directory.join(RESULT).exists());
    }
}
