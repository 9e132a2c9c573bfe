//! Files that are read in blocks of rows, so that memory does not grow with their length.

use super::table::{Format, require_different};
use super::{DataError, Table, delimited, numpy};
use ndarray::Array2;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};

/// A data file, read in blocks of rows from its beginning to its end: text or .npy in C order.
///
/// A block is a [`Table`], so [`channels`](super::channels) and [`Table::place`] apply to it.
pub struct Blocks {
    file: PathBuf,
    names: Vec<String>,
    scalars: BTreeMap<String, f64>,
    rows: Rows,
    /// Samples read so far.
    read: usize,
}

enum Rows {
    Text {
        rows: delimited::Rows<BufReader<File>>,
        /// For each column of the file, whether it is a scalar.
        is_scalar: Vec<bool>,
    },
    Npy(numpy::NpyRows<BufReader<File>>),
}

impl Blocks {
    /// Opens a file and reads its header.
    ///
    /// In a text file, a column is a scalar if it has a value in its first row and in none of the next thousand.
    ///
    /// # Errors
    /// Returns the errors of [`read`](super::read), and [`DataError::Malformed`] for a format that cannot be read in
    /// blocks.
    pub fn open(path: &Path) -> Result<Self, DataError> {
        let failed = |source| DataError::Io { file: path.into(), source };
        let mut file = BufReader::with_capacity(1 << 18, File::open(path).map_err(failed)?);
        let length = file.get_ref().metadata().map_err(failed)?.len();
        let mut scalars = BTreeMap::new();
        let (names, rows): (Vec<String>, Rows) = match Format::of(path, file.fill_buf().map_err(failed)?) {
            Format::Nothing => return Err(DataError::Empty { file: path.into() }),
            Format::Npz | Format::Mat => {
                let what = "only text and .npy files can be read in blocks of rows".into();
                return Err(DataError::Malformed { file: path.into(), what });
            }
            Format::Npy => {
                let rows = numpy::open_npy(path, file, length)?;
                ((1..=rows.columns).map(|i| i.to_string()).collect(), Rows::Npy(rows))
            }
            Format::Text => {
                let rows = delimited::Rows::open(path, file)?;
                let found = rows.scalars()?;
                let pairs = || rows.names().iter().zip(&found);
                scalars.extend(pairs().filter_map(|(name, value)| Some((name.clone(), (*value)?))));
                let names = pairs().filter(|(_, value)| value.is_none()).map(|(name, _)| name.clone()).collect();
                (names, Rows::Text { is_scalar: found.iter().map(Option::is_some).collect(), rows })
            }
        };
        require_different(path, &names)?;
        if names.is_empty() {
            return Err(DataError::NoSamples { file: path.into() });
        }
        Ok(Self { file: path.into(), names, scalars, rows, read: 0 })
    }

    /// Returns the names of the columns.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Reads the next rows, at most `most` of them. Returns `None` after the last one.
    ///
    /// # Errors
    /// Returns the errors of [`read`](super::read), and [`DataError::LateValue`] for a value far down in a column that
    /// seemed to be a scalar.
    ///
    /// # Panics
    /// Panics if `most` is 0.
    pub fn next_block(&mut self, most: usize) -> Result<Option<Table>, DataError> {
        assert!(most > 0, "a block has at least one row");
        let (mut values, mut lines) = (Vec::new(), Vec::new());
        let samples = match &mut self.rows {
            Rows::Npy(rows) => rows.next(most, &mut values)?,
            Rows::Text { rows, is_scalar } => {
                let mut cells = Vec::new();
                while lines.len() < most
                    && let Some(line) = rows.next(&mut cells)?
                {
                    cells.resize(is_scalar.len(), None);
                    for (i, cell) in cells.iter().enumerate() {
                        if !is_scalar[i] {
                            values.push(cell.unwrap_or(f64::NAN));
                        } else if cell.is_some() && self.read + lines.len() > 0 {
                            let (file, column) = (self.file.clone(), rows.names()[i].clone());
                            return Err(DataError::LateValue { file, line, column });
                        }
                    }
                    lines.push(line);
                }
                lines.len()
            }
        };
        if samples == 0 {
            return Ok(None);
        }
        let columns = Array2::from_shape_vec((samples, self.names.len()), values)
            .map_err(|error| DataError::Malformed { file: self.file.clone(), what: error.to_string() })?;
        let first = self.read;
        self.read += samples;
        Ok(Some(Table {
            source: self.file.clone(),
            names: self.names.clone(),
            columns,
            scalars: self.scalars.clone(),
            sha256: String::new(),
            lines,
            first,
            notes: Vec::new(),
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::read;
    use ndarray::{Axis, ShapeBuilder, concatenate};
    use ndarray_npy::WriteNpyExt;

    fn file(folder: &tempfile::TempDir, name: &str, content: &[u8]) -> PathBuf {
        let path = folder.path().join(name);
        std::fs::write(&path, content).unwrap();
        path
    }

    fn npy(array: &Array2<f64>) -> Vec<u8> {
        let mut bytes = Vec::new();
        array.write_npy(&mut bytes).unwrap();
        bytes
    }

    /// A file that is read in blocks has the names, scalars, values and places of the same file in memory.
    #[test]
    fn blocks_put_together_are_the_table() {
        let folder = tempfile::tempdir().unwrap();
        let matrix = Array2::from_shape_fn((10, 3), |(k, i)| (k * 3 + i) as f64 / 7.0);
        let texts = [
            "# said by\nu1,y 1\n\n1,-2.5\n  # a remark\n3,\n5,nan\n",
            "u1 \"y 1\"\n 1   -2.5\n3 4.0D-03\n\t5 6  \n",
            "\u{feff}\"u1\" , \"y 1\",\r\n1,-2.5,\r\n3,4e-3,\r\n5,6,\r\n",
            "1,5;2\n3;4\n5;6",
            "u,y,Fs\n1,2,400\n3,4\n5,6\n",
            "u,y,Fs,\n1,2,400,\n3,4,,\n5,6,,\n",
        ];
        let mut files: Vec<PathBuf> = vec![file(&folder, "m.npy", &npy(&matrix))];
        files.extend(texts.iter().enumerate().map(|(i, text)| file(&folder, &format!("{i}.csv"), text.as_bytes())));
        for path in files {
            let table = read(&path, None).unwrap();
            for most in [1, 2, 100] {
                let mut blocks = Blocks::open(&path).unwrap();
                assert_eq!(blocks.names(), table.names);
                let (mut parts, mut at) = (Vec::new(), 0);
                while let Some(block) = blocks.next_block(most).unwrap() {
                    assert_eq!((&block.names, &block.scalars), (&table.names, &table.scalars));
                    (0..block.samples()).for_each(|k| assert_eq!(block.place(k), table.place(at + k)));
                    at += block.samples();
                    parts.push(block.columns);
                }
                let views: Vec<_> = parts.iter().map(|part| part.view()).collect();
                let joined = concatenate(Axis(0), &views).unwrap();
                assert_eq!(joined.dim(), table.columns.dim());
                assert!(joined.iter().zip(&table.columns).all(|(a, b)| a == b || a.is_nan() && b.is_nan()));
            }
        }
    }

    #[test]
    fn what_cannot_be_read_in_blocks_is_said() {
        let folder = tempfile::tempdir().unwrap();
        let says = |path: &Path| Blocks::open(path).err().unwrap().to_string();
        let fortran = Array2::from_shape_fn((4, 2).f(), |(k, i)| (k + i) as f64);
        let said = says(&file(&folder, "f.npy", &npy(&fortran)));
        assert!(said.contains("f.npy: its numbers are stored by columns (Fortran order)"), "{said}");
        assert!(says(&file(&folder, "x.npz", b"PK\x03\x04")).contains("only text and .npy files"));
        assert!(says(&file(&folder, "empty.csv", b"")).contains("the file is empty"));
        let short = npy(&Array2::zeros((4, 2)));
        assert!(says(&file(&folder, "s.npy", &short[..short.len() - 8])).contains("64 bytes are announced, but 56"));
    }

    #[test]
    fn errors_in_a_later_block_name_file_and_line() {
        let folder = tempfile::tempdir().unwrap();
        let rows = |count: usize| (0..count).map(|k| format!("{k},1,\n")).collect::<String>();
        let says = |text: String| {
            let mut blocks = Blocks::open(&file(&folder, "x.csv", text.as_bytes())).unwrap();
            let mut next = || blocks.next_block(500).transpose();
            std::iter::from_fn(&mut next).find_map(Result::err).unwrap().to_string()
        };
        let head = "u,y,Fs\n0,1,400\n".to_owned() + &rows(1500);
        let place = folder.path().join("x.csv").display().to_string();
        assert_eq!(says(head.clone() + "1,off,\n"), format!("{place}, line 1503, column `y`: `off` is not a number"));
        assert_eq!(says(head.clone() + "1,2\n"), format!("{place}, line 1503: 2 cells where 3 are expected"));
        assert_eq!(
            says(head + "1,2,3\n"),
            format!("{place}, line 1503: column `Fs` has a value again after its first row")
        );
    }
}
