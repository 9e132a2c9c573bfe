//! Data tables in and out.

use std::path::Path;

use ndarray::Array2;
use plid::lab::data::{self, MissingPolicy, Table};
use plid::lab::report::write_atomic;
use plid::model::ModelError;

use super::Failure;

/// Rates with a smaller relative difference count as equal, because printed times are rounded.
const SAME_RATE: f64 = 1e-4;

/// Reads a file of any format that plid knows.
pub fn read(path: &Path) -> Result<Table, Failure> {
    Ok(data::read(path, None)?)
}

/// Returns the sample rate of a table: the given one, the table's own, or else the model's. If the table's rate
/// agrees with the model's, the model's is returned.
pub fn rate(table: &Table, given: Option<f64>, model_hz: f64) -> Result<f64, Failure> {
    // A single sample has no rate to contradict the model's.
    if given.is_none() && table.samples() < 2 {
        return Ok(model_hz);
    }
    let (rate, assumed) = data::sample_rate(table, given)?;
    let is_the_models = assumed.is_some() || (rate - model_hz).abs() <= SAME_RATE * model_hz;
    Ok(if is_the_models { model_hz } else { rate })
}

/// Checks that a record has the sample rate of the model or simulator for which it is intended. `input` and `of` are
/// the files of the record and of the model or simulator.
pub fn require_rate(table: &Table, input: &Path, model_hz: f64, of: &Path) -> Result<(), Failure> {
    let record_hz = rate(table, None, model_hz)?;
    if record_hz == model_hz {
        return Ok(());
    }
    let [record, model] = [input, of].map(|file| file.display().to_string());
    Err(ModelError::Rate { record, record_hz, model, model_hz }.into())
}

/// Whether two paths lead to the same existing file.
pub fn same_file(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

/// Returns the columns `names` of a table in that order, and checks that their values are finite.
pub fn pick(table: &Table, names: &[String]) -> Result<Array2<f64>, Failure> {
    Ok(data::channels(table, names, MissingPolicy::Error)?)
}

/// Writes columns with their names as CSV, either completely or not at all. A value that is not a number is an error
/// with its position.
pub fn write_csv(path: &Path, names: &[String], values: &Array2<f64>) -> Result<(), Failure> {
    if let Some(((row, column), value)) = values.indexed_iter().find(|(_, value)| !value.is_finite()) {
        let (path, name) = (path.display(), &names[column]);
        return Err(Failure::work(format!("{path}: `{name}` is {value} in row {}; nothing is written", row + 1)));
    }
    let text = data::to_csv(names, values);
    write_atomic(path, text.as_bytes()).map_err(|error| Failure::file(path, &error))
}
