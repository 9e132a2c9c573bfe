//! Data files.

use std::path::Path;

use ndarray::Array2;
use plid_data::{Table, read_bytes, to_csv};

use crate::{fuzz, words};

fn read(file: &str, bytes: &[u8]) -> String {
    let read = read_bytes(Path::new(file), bytes, None);
    if let Ok(table) = &read {
        require_text(table);
        let _ = plid_data::sample_rate(table, None);
    }
    words(read)
}

/// Checks that a table is written as text and read back the same.
fn require_text(table: &Table) {
    assert_eq!(table.names.len(), table.columns.ncols());
    let is_text = |name: &String| !name.is_empty() && name.trim() == name && !name.contains(char::is_control);
    if table.samples() == 0 || !table.names.iter().all(is_text) {
        return;
    }
    let text = to_csv(&table.names, &table.columns);
    let again = read_bytes(Path::new("again.csv"), text.as_bytes(), None)
        .unwrap_or_else(|error| panic!("{:?} is written as {text:?}, which is refused: {error}", table.names));
    assert_eq!(again.names, table.names, "{text:?}");
    assert!(same(&again.columns, &table.columns), "{:?} is read back as {:?}", table.columns, again.columns);
}

fn same(a: &Array2<f64>, b: &Array2<f64>) -> bool {
    a.dim() == b.dim() && a.iter().zip(b).all(|(a, b)| a == b || (a.is_nan() && b.is_nan()))
}

#[cfg_attr(test, test)]
pub fn csv() {
    fuzz("csv", 400, 20_000, |bytes| read("x.csv", bytes));
}

/// Compressed variables expand up to a thousand times, and a byte may become a number of eight.
#[cfg_attr(test, test)]
pub fn mat() {
    fuzz("mat", 50_000, 20_000, |bytes| read("x.mat", bytes));
}

#[cfg_attr(test, test)]
pub fn npy() {
    fuzz("npy", 400, 20_000, |bytes| read("x.npy", bytes));
}

#[cfg_attr(test, test)]
pub fn npz() {
    fuzz("npz", 50_000, 20_000, |bytes| read("x.npz", bytes));
}
