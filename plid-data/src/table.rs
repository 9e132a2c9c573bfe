//! A file as a table of named columns.
use super::{DataError, Warning, delimited, mat, numpy};
use ndarray::{Array2, ArrayView1};
use plid_file::Hashing;
use std::collections::{BTreeMap, HashSet};
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

/// The contents of a data file: columns of equal length, and scalars.
#[derive(Debug, Clone)]
pub struct Table {
    /// The file.
    pub source: PathBuf,
    /// Names of the columns.
    pub names: Vec<String>,
    /// Samples x columns, in the units of the file; NaN where a cell is empty.
    pub columns: Array2<f64>,
    /// Columns with a value in their first row only (such as `Fs`), and variables of one element.
    pub scalars: BTreeMap<String, f64>,
    /// SHA-256 of the file's bytes, in hexadecimal.
    pub sha256: String,
    /// For text, the line number of each sample in the file, from 1; otherwise empty.
    pub lines: Vec<usize>,
    /// Index of the first sample in the file, from 0. It is not 0 only for a [block](crate::Blocks) of a file.
    pub first: usize,
    /// Warnings about contents of the file that are not data.
    pub notes: Vec<Warning>,
}

/// Columns and scalars as the reader of one format finds them.
pub(super) struct Content {
    pub names: Vec<String>,
    pub columns: Array2<f64>,
    pub scalars: BTreeMap<String, f64>,
    pub lines: Vec<usize>,
    pub notes: Vec<Warning>,
}

/// Reads a data file. Its first bytes decide the format, or else its extension.
///
/// `variable` chooses one variable of a .mat or .npz file. Text and .npy files are read in pieces, so that only their
/// numbers are held in memory.
///
/// # Errors
/// Returns a [`DataError`] with the file and, for text, line and column.
pub fn read(path: &Path, variable: Option<&str>) -> Result<Table, DataError> {
    let failed = |source| DataError::Io { file: path.into(), source };
    let mut file = BufReader::new(File::open(path).map_err(failed)?);
    let metadata = file.get_ref().metadata().map_err(failed)?;
    if !metadata.is_file() {
        // The length of a pipe is not known.
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).map_err(failed)?;
        return read_bytes(path, &bytes, variable);
    }
    let length = metadata.len();
    let format = Format::of(path, file.fill_buf().map_err(failed)?);
    read_from(path, file, length, format, variable)
}

/// Reads the bytes of a data file. `path` names the file in messages, and its extension is used as in [`read`].
///
/// # Errors
/// Returns the errors of [`read`].
pub fn read_bytes(path: &Path, bytes: &[u8], variable: Option<&str>) -> Result<Table, DataError> {
    read_from(path, bytes, bytes.len() as u64, Format::of(path, bytes), variable)
}

/// The format of a file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Format {
    Nothing,
    Npz,
    Npy,
    Mat,
    Text,
}

impl Format {
    /// Returns the format according to the first bytes of a file, or else to its extension.
    pub fn of(path: &Path, first: &[u8]) -> Self {
        let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
        match extension.as_str() {
            _ if first.is_empty() => Self::Nothing,
            _ if first.starts_with(b"PK\x03\x04") => Self::Npz,
            "npz" => Self::Npz,
            _ if first.starts_with(b"\x93NUMPY") => Self::Npy,
            "npy" => Self::Npy,
            _ if first.starts_with(b"MATLAB") => Self::Mat,
            "mat" => Self::Mat,
            _ => Self::Text,
        }
    }
}

fn read_from(
    path: &Path,
    file: impl BufRead,
    length: u64,
    format: Format,
    variable: Option<&str>,
) -> Result<Table, DataError> {
    let failed = |source| DataError::Io { file: path.into(), source };
    let mut file = BufReader::new(Hashing::new(file));
    let mut whole = Vec::new();
    if matches!(format, Format::Npz | Format::Mat) {
        file.read_to_end(&mut whole).map_err(failed)?;
    }
    let content = match format {
        Format::Nothing => Err(DataError::Empty { file: path.into() }),
        Format::Npz => numpy::read_npz(path, &whole, variable),
        Format::Npy => numpy::read_npy(path, &mut file, length),
        Format::Mat => mat::read(path, &whole, variable),
        Format::Text => delimited::read(path, &mut file),
    }?;
    require_different(path, &content.names)?;
    Ok(Table {
        source: path.into(),
        names: content.names,
        columns: content.columns,
        scalars: content.scalars,
        sha256: file.into_inner().sha256().map_err(failed)?,
        lines: content.lines,
        first: 0,
        notes: content.notes,
    })
}

/// Checks that no two columns have the same name.
pub(super) fn require_different(path: &Path, names: &[String]) -> Result<(), DataError> {
    let mut seen = HashSet::new();
    match names.iter().find(|name| !seen.insert(*name)) {
        Some(name) => Err(DataError::DuplicateColumn { file: path.into(), name: name.clone() }),
        None => Ok(()),
    }
}

impl Table {
    /// Returns the number of samples.
    pub fn samples(&self) -> usize {
        self.columns.nrows()
    }

    /// Returns the column with a name, if there is one.
    pub fn column(&self, name: &str) -> Option<ArrayView1<'_, f64>> {
        let index = self.names.iter().position(|n| n == name)?;
        Some(self.columns.column(index))
    }

    /// Returns the place of sample `k` (from 0) for messages: a line of the file, or a row.
    pub fn place(&self, k: usize) -> String {
        match self.lines.get(k) {
            Some(line) => format!("line {line}"),
            None => format!("row {}", self.first + k + 1),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hash_is_that_of_the_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.csv");
        std::fs::write(&path, "a,b\n1,2\n3,4\n").unwrap();
        let table = read(&path, None).unwrap();
        // printf 'a,b\n1,2\n3,4\n' | sha256sum
        assert_eq!(table.sha256, "b9485148546419a0f6a85e8d708c923557c15d7f3c7d078ef1fa7f7c0f57d5a5");
        assert_eq!(table.column("b").unwrap().to_vec(), [2.0, 4.0]);
        assert!(table.column("c").is_none());
    }

    #[test]
    fn missing_and_empty_files_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.csv");
        let error = read(&path, None).unwrap_err();
        assert!(matches!(error, DataError::Io { .. }));
        assert!(error.to_string().contains("x.csv"));
        std::fs::write(&path, "").unwrap();
        assert!(matches!(read(&path, None), Err(DataError::Empty { .. })));
    }

    #[test]
    fn two_columns_of_one_name_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.csv");
        std::fs::write(&path, "a,b,a\n1,2,3\n3,4,5\n").unwrap();
        let error = read(&path, None).unwrap_err();
        assert!(matches!(error, DataError::DuplicateColumn { name, .. } if name == "a"));
    }
}
