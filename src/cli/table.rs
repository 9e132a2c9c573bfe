//! Data tables in and out.

use std::fmt::Write as _;
use std::path::Path;

use ndarray::Array2;
use plid::lab::data::{self, Table};
use plid::lab::report::write_atomic;

use super::Failure;

/// Reads a file of any format that plid knows.
pub fn read(path: &Path) -> Result<Table, Failure> {
    Ok(data::read(path, None)?)
}

/// The columns `names` of a table, in that order; a channel that it lacks is an error with what it has.
pub fn pick(table: &Table, names: &[String]) -> Result<Array2<f64>, Failure> {
    let columns: Result<Vec<_>, Failure> = names
        .iter()
        .map(|name| {
            table.column(name).ok_or_else(|| {
                let present = table.names.join(", ");
                Failure::input(format!("{}: no channel `{name}`; it has {present}", table.source.display()))
            })
        })
        .collect();
    let columns = columns?;
    Ok(Array2::from_shape_fn((table.samples(), names.len()), |(k, i)| columns[i][k]))
}

/// Writes columns under their names as CSV, whole or not at all.
pub fn write_csv(path: &Path, names: &[String], values: &Array2<f64>) -> Result<(), Failure> {
    let mut text = names.join(",");
    text.push('\n');
    for row in values.rows() {
        for (i, value) in row.iter().enumerate() {
            if i > 0 {
                text.push(',');
            }
            let _ = write!(text, "{value}");
        }
        text.push('\n');
    }
    write_atomic(path, text.as_bytes()).map_err(|e| Failure::work(format!("{}: {e}", path.display())))
}
