//! Selection of the number of states and of the observability indices.

use plid_core::ObservableForm;
use serde::{Deserialize, Serialize};

use super::IdentifyError;
use super::noise::{Bank, Search, tune};

/// The result for one order.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ScanRow {
    /// Number of states n.
    pub states: usize,
    /// Observability indices n_1, ..., n_p.
    pub indices: Vec<usize>,
    /// Relative simulation error of the best filter on the scoring part of the training data; `None` if no filter gave
    /// a model.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub free_run: Option<f64>,
}

/// The results of a scan over orders.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OrderScan {
    /// One row per order, in increasing order.
    pub rows: Vec<ScanRow>,
    /// The smallest order whose error is within a factor of the smallest error. The factor is [`OrderScan::SLACK`], or
    /// larger if few samples score the models.
    pub recommended: usize,
}

impl OrderScan {
    /// The largest permissible ratio of the error of a smaller model to the smallest error, if many samples score the
    /// models.
    pub const SLACK: f64 = 1.05;

    /// Selects the order from the rows of a scan: the smallest order whose error is within the factor `slack` of the
    /// smallest error. Returns `None` if no order gave a model.
    pub(crate) fn of(mut rows: Vec<ScanRow>, slack: f64) -> Option<Self> {
        rows.sort_by_key(|row| row.states);
        let best = rows.iter().filter_map(|row| row.free_run).fold(f64::INFINITY, f64::min);
        let row = rows.iter().find(|row| row.free_run.is_some_and(|e| e <= slack * best))?;
        Some(Self { recommended: row.states, rows })
    }
}

/// Tunes and scores each order with evenly distributed indices. `template` returns the filter bank of an order.
///
/// # Errors
/// Returns [`IdentifyError::NoSetting`] if no order gave a model.
pub fn scan_orders(
    orders: &[usize],
    template: impl Fn(usize) -> Result<Bank, IdentifyError>,
    search: &mut Search<'_>,
) -> Result<OrderScan, IdentifyError> {
    let mut rows = Vec::new();
    let mut failure = None;
    for &states in orders {
        let bank = template(states)?;
        let free_run = match tune(&bank, search) {
            Ok(tuned) => tuned.best.free_run,
            Err(IdentifyError::Interrupted) => return Err(IdentifyError::Interrupted),
            Err(error) => {
                failure = Some(error);
                None
            }
        };
        rows.push(ScanRow { states, indices: bank.form.indices().to_vec(), free_run });
    }
    OrderScan::of(rows, OrderScan::SLACK).ok_or(failure.unwrap_or(IdentifyError::NoSetting { trials: 0 }))
}

/// Moves one state at a time from one output to another as long as this reduces the simulation error by more than two
/// per cent. Returns the best indices and the rows of all indices that gave a model.
///
/// # Errors
/// Returns [`IdentifyError::NoSetting`] if the initial indices gave no model.
pub fn search_indices(
    start: &ObservableForm,
    template: impl Fn(&[usize]) -> Result<Bank, IdentifyError>,
    search: &mut Search<'_>,
) -> Result<(Vec<usize>, Vec<ScanRow>), IdentifyError> {
    let row = |indices: &[usize], free_run| ScanRow {
        states: indices.iter().sum(),
        indices: indices.to_vec(),
        free_run: Some(free_run),
    };
    let mut score = |indices: &[usize]| -> Result<f64, IdentifyError> {
        Ok(tune(&template(indices)?, search)?.best.free_run.unwrap_or(f64::INFINITY))
    };
    let mut indices = start.indices().to_vec();
    let mut error = score(&indices)?;
    let mut rows = vec![row(&indices, error)];
    loop {
        let mut better: Option<(Vec<usize>, f64)> = None;
        for from in 0..indices.len() {
            for to in 0..indices.len() {
                if from == to || indices[from] < 2 {
                    continue;
                }
                let mut candidate = indices.clone();
                candidate[from] -= 1;
                candidate[to] += 1;
                if rows.iter().any(|row| row.indices == candidate) {
                    continue;
                }
                // A neighbour without a model does not end the search.
                let found = match score(&candidate) {
                    Ok(found) => found,
                    Err(IdentifyError::Interrupted) => return Err(IdentifyError::Interrupted),
                    Err(_) => continue,
                };
                rows.push(row(&candidate, found));
                if found < 0.98 * error && better.as_ref().is_none_or(|(_, e)| found < *e) {
                    better = Some((candidate, found));
                }
            }
        }
        match better {
            Some((candidate, found)) => (indices, error) = (candidate, found),
            None => return Ok((indices, rows)),
        }
    }
}
