//! Columns as text.

use std::fmt::Write as _;

use ndarray::Array2;

/// Returns columns under their names as CSV. [`read`](crate::read) finds the same names and numbers if no name is
/// empty, begins or ends with a blank, or contains a control character.
pub fn to_csv(names: &[String], values: &Array2<f64>) -> String {
    let mut text = names.iter().map(|name| header(name)).collect::<Vec<_>>().join(",");
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
    text
}

/// Returns a name in a form that reads back as one: in quotes if it could be read as a number or as several cells.
fn header(name: &str) -> String {
    let is_plain = name.parse::<f64>().is_err()
        && name.starts_with(|c: char| c.is_alphabetic())
        && name.chars().all(|c| c.is_alphanumeric() || "_.-()[]/".contains(c));
    if is_plain { name.to_string() } else { format!("\"{}\"", name.replace('"', "\"\"")) }
}
