//! The table of a sweep, with the varied keys, the figures of each run, and the error of a point without figures.

use serde_json::Value;

use super::grid::Sweep;
use super::point::Row;

/// A figure of a run.
pub(super) struct Figure {
    /// The name of the column.
    pub name: &'static str,
    /// The location of the figure in the result.json of a run as a JSON pointer, and that in the result.json of
    /// merged runs if it differs.
    places: &'static [&'static str],
}

impl Figure {
    /// Returns the figure from a result.json. For a list, it is the number of items.
    pub fn of(&self, result: &Value) -> Option<Value> {
        let value = self.places.iter().find_map(|place| result.pointer(place))?;
        Some(value.as_array().map_or_else(|| value.clone(), |list| list.len().into()))
    }
}

const fn figure(name: &'static str, places: &'static [&'static str]) -> Figure {
    Figure { name, places }
}

const FREE_RUN: &str = "free_run_relative";
const REFINED: &str = "refined_free_run_relative";

/// The models whose errors are drawn: the column of the free-run error, and the name of the model.
pub(super) const MODELS: [(&str, &str); 2] = [(FREE_RUN, "recursive"), (REFINED, "refined")];

/// The figures of a run. Errors are those on held-out data, as RMS over RMS of the output, for all outputs together.
pub(super) const FIGURES: [Figure; 10] = [
    figure("states", &["/states"]),
    figure("training_samples", &["/training_samples"]),
    figure("one_step_relative", &["/held_out/one_step/overall_relative", "/held_out/0/one_step/overall_relative"]),
    figure(FREE_RUN, &["/held_out/free_run/overall_relative", "/held_out/0/free_run/overall_relative"]),
    figure("free_run_diverges", &["/held_out/free_run/diverges", "/held_out/0/free_run/diverges"]),
    figure(REFINED, &["/simulation/refined/free_run/overall_relative"]),
    figure("subspace_free_run_relative", &["/simulation/subspace/free_run/overall_relative"]),
    figure("best_free_run", &["/simulation/best_free_run"]),
    figure(
        "true_plant_relative",
        &[
            "/held_out/free_run_of_the_true_plant/overall_relative",
            "/held_out/0/free_run_of_the_true_plant/overall_relative",
        ],
    ),
    figure("warnings", &["/warnings"]),
];

/// Returns a figure of a row as a number.
pub(super) fn number(row: &Row, name: &str) -> Option<f64> {
    let column = FIGURES.iter().position(|figure| figure.name == name)?;
    row.figures[column].as_ref().and_then(Value::as_f64)
}

/// Returns the names of the columns.
pub(super) fn header(sweep: &Sweep) -> Vec<&str> {
    let keys = sweep.varied.iter().map(|varied| varied.key.as_str());
    let figures = FIGURES.iter().map(|figure| figure.name);
    std::iter::once("point").chain(keys).chain(figures).chain(["error"]).collect()
}

/// Returns the cells of a row as text. A figure that the run does not have is empty.
pub(super) fn cells(row: &Row) -> Vec<String> {
    let text = |figure: &Option<Value>| match figure {
        Some(Value::String(word)) => word.clone(),
        Some(value) => value.to_string(),
        None => String::new(),
    };
    let figures = row.figures.iter().map(text);
    let error = row.error.clone().unwrap_or_default();
    std::iter::once(row.number.clone()).chain(row.values.iter().cloned()).chain(figures).chain([error]).collect()
}

/// Returns the table as CSV.
pub(super) fn csv(sweep: &Sweep, rows: &[Row]) -> Vec<u8> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    let lines = rows.iter().map(cells);
    writer.write_record(header(sweep)).expect("a Vec takes everything");
    lines.for_each(|line| writer.write_record(line).expect("all rows are of one length"));
    writer.into_inner().expect("a Vec takes everything")
}
