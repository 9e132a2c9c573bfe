use std::fs::{self, File};
use std::io::{self, Write};
use std::path::Path;

use crate::Scratch;

/// Writes a new folder with these files whole or not at all. Several processes may do so at once: one of them succeeds.
///
/// # Errors
/// Returns [`io::ErrorKind::AlreadyExists`] if the folder is there, or the error of the file system.
pub fn write_folder<'a>(place: &Path, files: impl IntoIterator<Item = (&'a str, &'a [u8])>) -> io::Result<()> {
    let (Some(name), Some(parent)) = (place.file_name(), place.parent()) else {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, format!("{} names no folder", place.display())));
    };
    let beside = Scratch::new(parent, name)?;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_written_once() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("case");
        fs::create_dir(folder.path().join(".case.x1.plid-tmp")).unwrap();
        write_folder(&place, [("a", &b"1"[..]), ("b", b"2")]).unwrap();
        let again = write_folder(&place, [("a", &b"3"[..])]).unwrap_err();
        assert_eq!(again.kind(), io::ErrorKind::AlreadyExists);
        assert_eq!(fs::read(place.join("a")).unwrap(), b"1");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "nothing else is left");
        assert!(write_folder(Path::new("/"), []).is_err());
    }
}
