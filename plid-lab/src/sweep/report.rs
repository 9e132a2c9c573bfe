//! The report of a sweep: the results in sentences, a figure, and the table.

use serde_json::Value;

use super::grid::Sweep;
use super::picture::picture;
use super::point::Row;
use super::table::{self, MODELS};
use plid_report::{Cell, Report, Table, percent};

/// Returns the page.
pub(super) fn page(sweep: &Sweep, rows: &[Row]) -> Report {
    let keys: Vec<&str> = sweep.varied.iter().map(|varied| varied.key.as_str()).collect();
    let failed = match rows.iter().filter(|row| row.error.is_some()).count() {
        0 => "Every point has a result.".to_owned(),
        count => format!("{count} of them have no result; the last column of the table says why."),
    };
    let mut report = Report::new(format!("Sweep: {}", sweep.name)).verdict(format!(
        "{} points over {}. {failed}",
        rows.len(),
        keys.join(", ")
    ));
    for (name, model) in MODELS {
        report = match best(rows, name) {
            Some((row, error)) => report.verdict(format!(
                "The {model} model has its smallest free-run error on held-out data, {}, at point {}: {}.",
                percent(error),
                row.number,
                setting(&keys, &row.values)
            )),
            None => report,
        };
    }
    if let Some(svg) = picture(sweep, rows) {
        report = report.figure(svg, "Free-run error on held-out data over the varied keys.");
    }
    report = report.table(rows.iter().fold(header(sweep), |table, row| table.row(cells(row))));
    report.provenance("program", format!("plid {}", env!("CARGO_PKG_VERSION")))
}

/// Returns the row with the smallest value of a figure; of several, the first.
fn best<'a>(rows: &'a [Row], name: &str) -> Option<(&'a Row, f64)> {
    rows.iter().filter_map(|row| Some((row, table::number(row, name)?))).min_by(|a, b| a.1.total_cmp(&b.1))
}

fn setting(keys: &[&str], values: &[String]) -> String {
    let each = keys.iter().zip(values).map(|(key, value)| format!("{key} = {value}"));
    each.collect::<Vec<_>>().join(", ")
}

fn header(sweep: &Sweep) -> Table {
    let caption = "All points. Errors are those on held-out data, RMS over RMS of the output; the files of a point are \
        in points/NUMBER.";
    table::header(sweep).into_iter().fold(Table::new(caption), |table, name| table.column(name, ""))
}

fn cells(row: &Row) -> Vec<Cell> {
    let text = |cell: String| if cell.parse::<f64>().is_ok() { Cell::Number(cell) } else { Cell::Text(cell) };
    let first = 1 + row.values.len();
    let mut cells: Vec<Cell> = table::cells(row).into_iter().map(text).collect();
    for (cell, figure) in cells[first..].iter_mut().zip(&row.figures) {
        if let Some(value) = figure.as_ref().filter(|value| value.is_f64()).and_then(Value::as_f64) {
            *cell = Cell::significant(value, 4);
        }
    }
    cells
}
