use std::fs::{self, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use tempfile::{Builder, NamedTempFile};

use crate::leftover::{Lock, SUFFIX, claim, clear, prefix};

/// Number of links that are followed before they count as a loop, as in Linux.
const LINKS: usize = 40;

/// Writes a file completely or not at all. The bytes are written to a temporary file in the same folder, which then
/// takes the name of the file. A reader sees either the old or the new content, even after a crash. The permissions
/// of an old file are kept.
///
/// A link is followed, so that it stays a link and the file it names is replaced. A path that is neither a file nor
/// missing (a device, a pipe) is written to directly. Temporary files that a killed process left for this file are
/// removed.
///
/// # Errors
/// Returns the error of the file system. The temporary file is then removed and `path` is as it was.
pub fn write_atomic(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let old = match fs::metadata(path) {
        Ok(old) if old.is_dir() => return Err(io::ErrorKind::IsADirectory.into()),
        Ok(old) if !old.is_file() => return OpenOptions::new().write(true).open(path)?.write_all(bytes),
        other => other.ok(),
    };
    let target = followed(path)?;
    let (mut file, _lock) = neighbour(&target)?;
    file.write_all(bytes)?;
    if let Some(old) = old {
        file.as_file().set_permissions(old.permissions())?;
    }
    file.as_file().sync_all()?;
    file.persist(&target)?;
    Ok(())
}

/// Returns the file at the end of a chain of links. It may be missing.
fn followed(path: &Path) -> io::Result<PathBuf> {
    let mut target = path.to_path_buf();
    for _ in 0..LINKS {
        match fs::read_link(&target) {
            // A relative link starts from the folder that it is in.
            Ok(next) => target = target.parent().unwrap_or(Path::new("")).join(next),
            Err(_) => return Ok(target),
        }
    }
    Err(io::Error::new(io::ErrorKind::InvalidInput, format!("{}: the links go in a circle", path.display())))
}

/// Creates a temporary file in the folder of `target`, and returns it with its lock.
fn neighbour(target: &Path) -> io::Result<(NamedTempFile, Lock)> {
    let Some(name) = target.file_name() else {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, format!("{} names no file", target.display())));
    };
    let folder = target.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    clear(folder, name);
    let prefix = prefix(name);
    let mut builder = Builder::new();
    builder.prefix(&prefix).suffix(SUFFIX);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // As for any new file, the system removes the permissions in the user's mask.
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    loop {
        let file = builder.tempfile_in(folder)?;
        if let Some(lock) = claim(file.path())? {
            return Ok((file, lock));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ffi::OsString;

    fn names(folder: &Path) -> Vec<OsString> {
        let mut names: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_file_is_replaced_and_nothing_else_is_left() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("report.html");
        write_atomic(&path, b"old and long").unwrap();
        write_atomic(&path, b"new").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        assert_eq!(names(folder.path()), ["report.html"]);
    }

    #[test]
    fn a_failure_leaves_what_was_there() {
        let folder = tempfile::tempdir().unwrap();
        // A folder cannot be replaced by a file.
        let taken = folder.path().join("taken");
        fs::create_dir(&taken).unwrap();
        fs::write(taken.join("inside"), b"kept").unwrap();
        assert_eq!(write_atomic(&taken, b"new").unwrap_err().kind(), io::ErrorKind::IsADirectory);
        assert_eq!(fs::read(taken.join("inside")).unwrap(), b"kept");
        assert_eq!(names(folder.path()), ["taken"]);
        assert_eq!(
            write_atomic(&folder.path().join("missing/file"), b"x").unwrap_err().kind(),
            io::ErrorKind::NotFound
        );
        assert!(write_atomic(Path::new("/"), b"x").is_err());
    }

    #[test]
    fn leftovers_of_a_killed_process_are_removed_and_those_of_a_living_one_kept() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("model.json");
        fs::write(folder.path().join(".model.json.x1.plid-tmp"), b"half").unwrap();
        fs::write(folder.path().join(".other.json.x1.plid-tmp"), b"half").unwrap();
        let (living, _lock) = neighbour(&path).unwrap();
        write_atomic(&path, b"whole").unwrap();
        let living = living.path().file_name().unwrap().to_owned();
        let mut expected = vec![living, ".other.json.x1.plid-tmp".into(), "model.json".into()];
        expected.sort();
        assert_eq!(names(folder.path()), expected);
    }

    #[cfg(unix)]
    mod unix {
        use super::*;
        use std::fs::File;
        use std::io::Read;
        use std::os::unix::fs::{FileTypeExt, PermissionsExt, symlink};

        #[test]
        fn a_link_stays_a_link() {
            let folder = tempfile::tempdir().unwrap();
            let at = |name: &str| folder.path().join(name);
            fs::create_dir(at("data")).unwrap();
            // The file does not exist yet. The second link leads to the first.
            symlink("data/real.csv", at("first.csv")).unwrap();
            symlink("first.csv", at("second.csv")).unwrap();
            for content in ["new", "newer"] {
                write_atomic(&at("second.csv"), content.as_bytes()).unwrap();
                assert_eq!(fs::read_to_string(at("data/real.csv")).unwrap(), content);
            }
            assert!(at("first.csv").is_symlink() && at("second.csv").is_symlink());
            symlink("circle", at("circle")).unwrap();
            assert_eq!(write_atomic(&at("circle"), b"x").unwrap_err().kind(), io::ErrorKind::InvalidInput);
        }

        #[test]
        fn a_device_and_a_pipe_are_written_to() {
            write_atomic(Path::new("/dev/null"), b"gone").unwrap();
            assert!(fs::metadata("/dev/null").unwrap().file_type().is_char_device());
            let folder = tempfile::tempdir().unwrap();
            let pipe = folder.path().join("pipe");
            assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
            let reader = std::thread::spawn({
                let pipe = pipe.clone();
                move || {
                    let mut read = String::new();
                    File::open(pipe).unwrap().read_to_string(&mut read).map(|_| read)
                }
            });
            write_atomic(&pipe, b"through").unwrap();
            assert_eq!(reader.join().unwrap().unwrap(), "through");
            assert!(fs::metadata(&pipe).unwrap().file_type().is_fifo());
        }

        #[test]
        fn permissions_are_those_of_any_file() {
            let folder = tempfile::tempdir().unwrap();
            let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o777;
            let [plain, path] = ["plain", "path"].map(|name| folder.path().join(name));
            fs::write(&plain, b"").unwrap();
            write_atomic(&path, b"").unwrap();
            assert_eq!(mode(&path), mode(&plain));
            fs::set_permissions(&path, fs::Permissions::from_mode(0o640)).unwrap();
            write_atomic(&path, b"new").unwrap();
            assert_eq!(mode(&path), 0o640);
        }
    }
}
