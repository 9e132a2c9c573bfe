//! The cells as flat rows, one per method.

use serde::Serialize;

use super::cell::{Finished, Score};
use super::config::{Config, Plant};
use super::statistics::{Figure, consistent_band};

/// A row of expectations.csv. `_error` is a standard error; an empty field is a figure that does not exist.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    plant: String,
    signal_to_noise: f64,
    sigma: f64,
    sigma_is: &'static str,
    method: String,
    runs: usize,
    lost: usize,
    useless: usize,
    nees: Option<f64>,
    nees_error: Option<f64>,
    nees_consistent_from: Option<f64>,
    nees_consistent_to: Option<f64>,
    nees_a: Option<f64>,
    nees_a_error: Option<f64>,
    rmse_a: Option<f64>,
    rmse_a_error: Option<f64>,
    rmse_b: Option<f64>,
    rmse_b_error: Option<f64>,
    reference: Option<String>,
    rmse_a_over_reference: Option<f64>,
    rmse_a_over_reference_error: Option<f64>,
    rmse_a_over_default: Option<f64>,
    rmse_a_over_default_error: Option<f64>,
    free_run: Option<f64>,
    free_run_error: Option<f64>,
    free_run_over_default: Option<f64>,
    free_run_over_default_error: Option<f64>,
}

/// Returns the interval that contains the NEES of a consistent filter with probability 0.95, or `None` for the truss.
pub fn band(config: &Config, cell: &Finished) -> Option<(f64, f64)> {
    let parameters = match config.plants().find(|plant| plant.name() == cell.plant)? {
        Plant::Scalar(_) => 2,
        Plant::InClass(plant) => (plant.outputs + plant.inputs) * plant.states,
        Plant::Truss(_) => return None,
    };
    consistent_band(cell.runs, parameters)
}

/// Returns all rows in the order of the cells.
pub fn rows(config: &Config, cells: &[Finished]) -> Vec<Row> {
    cells.iter().flat_map(|cell| cell.scores.iter().map(|score| row(cell, score, band(config, cell)))).collect()
}

fn row(cell: &Finished, score: &Score, band: Option<(f64, f64)>) -> Row {
    let value = |figure: Option<Figure>| figure.map(|f| f.value);
    let error = |figure: Option<Figure>| figure.map(|f| f.error);
    // The band applies only to methods that give a covariance.
    let band = band.filter(|_| score.nees.is_some());
    Row {
        plant: cell.plant.clone(),
        signal_to_noise: cell.signal_to_noise,
        sigma: cell.sigma,
        sigma_is: if cell.plant.starts_with("truss") { "told over R" } else { "told over true" },
        method: score.method.clone(),
        runs: cell.runs,
        lost: score.lost,
        useless: score.useless,
        nees: value(score.nees),
        nees_error: error(score.nees),
        nees_consistent_from: band.map(|b| b.0),
        nees_consistent_to: band.map(|b| b.1),
        nees_a: value(score.nees_a),
        nees_a_error: error(score.nees_a),
        rmse_a: value(score.rmse_a),
        rmse_a_error: error(score.rmse_a),
        rmse_b: value(score.rmse_b),
        rmse_b_error: error(score.rmse_b),
        reference: cell.reference.clone(),
        rmse_a_over_reference: value(score.rmse_a_over_reference),
        rmse_a_over_reference_error: error(score.rmse_a_over_reference),
        rmse_a_over_default: value(score.rmse_a_over_default),
        rmse_a_over_default_error: error(score.rmse_a_over_default),
        free_run: value(score.free_run),
        free_run_error: error(score.free_run),
        free_run_over_default: value(score.free_run_over_default),
        free_run_over_default_error: error(score.free_run_over_default),
    }
}
