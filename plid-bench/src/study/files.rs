use std::path::Path;

use plid_file::{to_json, write_atomic};
use serde::Serialize;

use super::StudyError;

/// Writes a file atomically.
///
/// # Errors
/// Returns [`StudyError::File`].
pub fn write(path: &Path, content: impl AsRef<[u8]>) -> Result<(), StudyError> {
    write_atomic(path, content.as_ref()).map_err(StudyError::file(path))
}

/// Writes a value as indented JSON.
///
/// # Errors
/// Returns [`StudyError::NotFinite`] or [`StudyError::File`].
///
/// # Panics
/// Panics if the type cannot be represented in JSON, which is a fault of the type and not of its value.
pub fn write_json<T: Serialize>(path: &Path, value: &T) -> Result<(), StudyError> {
    write(path, to_json(value).map_err(StudyError::not_finite(path))?)
}

/// Writes rows as CSV under the names of their fields; `None` is an empty cell.
///
/// # Errors
/// Returns [`StudyError::File`].
///
/// # Panics
/// Panics if a row is not flat, which is a fault of its type.
pub fn write_csv<T: Serialize>(path: &Path, rows: impl IntoIterator<Item = T>) -> Result<(), StudyError> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for row in rows {
        writer.serialize(row).expect("rows are flat by construction");
    }
    write(path, writer.into_inner().expect("a Vec takes everything"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Serialize)]
    struct Row {
        name: &'static str,
        time_us: Option<f64>,
    }

    #[test]
    fn a_result_that_is_not_finite_is_not_written() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("t.json");
        let said = write_json(&path, &Row { name: "a", time_us: Some(f64::NAN) }).unwrap_err().to_string();
        assert!(said.contains("t.json: `time_us` is NaN") && !path.exists(), "{said}");
    }

    #[test]
    fn a_table_has_names_quotes_and_gaps() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("t.csv");
        write_csv(&path, [Row { name: "a, b", time_us: Some(0.5) }, Row { name: "c", time_us: None }]).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "name,time_us\n\"a, b\",0.5\nc,\n");
    }
}
