//! A subspace estimate by PO-MOESP (Verhaegen 1994; Van Overschee and De Moor 1996, chapter 4, with the weightings W1 =
//! I and W2 = the projection onto the complement of the future inputs).
//!
//! The rows [future inputs, past inputs, past outputs, future outputs] of every window of 2 i samples without a gap are
//! reduced to a triangular factor, a block of rows at a time, so that memory does not grow with the records. From this
//! factor,
//!
//! ```text
//! L32 = U S V',    Gamma = the first n columns of U S^{1/2},    A from Gamma's shift, C its first p rows.
//! ```
//!
//! Poles outside the unit circle are mirrored into it, and poles slower than the limit are made faster. B, D and the
//! initial states are then fitted to all records by least squares on the simulation error, which contributes much to
//! the quality of the estimate.

use faer::{Mat, MatRef};
use nalgebra::{DMatrix, DVector};
use plid_model::Model;
use rayon::prelude::*;

use crate::error::RefineError;
use crate::normal::Free;
use crate::point::Point;
use crate::record::{Data, Record, Scaled};
use crate::refine::{Options, check, in_units, initial_states};
use crate::sections::Sections;

/// Number of rows by which a triangular factor is updated at a time, as a multiple of its columns.
const BLOCK: usize = 2;
/// Number of parts into which the windows are divided. It is independent of the number of threads, so that results are
/// bit-identical.
const PARTS: usize = 2;
/// Directions of Gamma with a smaller singular value, relative to the largest, count as rounding.
pub(crate) const RANK: f64 = 1e-13;

/// A subspace estimate.
#[derive(Clone, Debug)]
pub struct Subspace {
    /// The model in block-diagonal coordinates, with channels named u1, u2, ... and y1, y2, ...
    pub model: Model,
    /// State at the first sample of each record.
    pub initial_states: Vec<DVector<f64>>,
    /// Singular values of L32 in decreasing order; a gap among them suggests the order.
    pub singular_values: Vec<f64>,
    /// Half the window, i, in samples.
    pub horizon: usize,
    /// Number of poles that were outside the unit circle and have been mirrored.
    pub mirrored: usize,
}

/// Returns the default for half the window: three times what the order requires, and at least 10 samples.
fn default_horizon(states: usize, outputs: usize) -> usize {
    (3 * states).div_ceil(outputs).max(10)
}

/// Estimates a model with `states` states. `horizon` is half the window in samples; the default is 3 n / p and at least
/// 10.
///
/// # Errors
/// Returns a [`RefineError`] for records that are empty, inconsistent or not finite, for settings out of range, and if
/// there are too few windows without a gap.
pub fn subspace(
    records: &[Record<'_>],
    states: usize,
    horizon: Option<usize>,
    sample_rate_hz: f64,
    options: &Options,
) -> Result<Subspace, RefineError> {
    let data = Data::new(records)?;
    check(states, &data, options)?;
    let (m, p) = (data.m(), data.p());
    let i = horizon.unwrap_or(default_horizon(states, p));
    if p * (i.max(1) - 1) < states {
        let expected = "large enough that p (horizon - 1) is at least the number of states";
        return Err(RefineError::Setting { setting: "horizon", value: i as f64, expected });
    }
    let window = Window::new(&data, i)?;
    let (a, c) = window.shift(states)?;
    // The iteration of nalgebra does not terminate for some matrices, and faer is used instead: beyond the order of
    // the data, A consists of rounding errors.
    let poles = Mat::from_fn(states, states, |row, column| a[(row, column)]).eigenvalues();
    let poles = poles.map_err(|_| failed("the eigenvalues of A"))?;
    let mirrored = poles.iter().filter(|z| z.norm() > 1.0).count();
    let sections = Sections::of_poles(&a, &c, m, options.radius, options.feedthrough)?;
    let point = Point::new(sections, &data).fit(&data, Free::Inputs)?;
    Ok(Subspace {
        model: in_units(&point.model, &data, sample_rate_hz)?,
        initial_states: initial_states(&point, &data),
        singular_values: window.singular_values,
        horizon: i,
        mirrored,
    })
}

/// The information of the windows of 2 i samples about the observable directions.
pub(crate) struct Window {
    /// U, a square matrix of size p i.
    directions: Mat<f64>,
    /// Singular values of L32 in decreasing order.
    pub singular_values: Vec<f64>,
    outputs: usize,
}

impl Window {
    /// Decomposes the windows of the records.
    ///
    /// # Errors
    /// Returns an error if there are too few windows without a gap.
    pub fn new(data: &Data, i: usize) -> Result<Self, RefineError> {
        let (m, p) = (data.m(), data.p());
        let factor = triangle(data, i)?;
        let (inputs, past) = (m * i, (2 * m + p) * i);
        // The rows of R are the columns of L; L32 is the part of the future outputs along the past.
        let l32 = Mat::from_fn(p * i, past - inputs, |row, column| factor[(inputs + column, past + row)]);
        let svd = l32.thin_svd().map_err(|_| failed("the singular value decomposition"))?;
        let singular_values = svd.S().column_vector().iter().copied().collect();
        Ok(Self { directions: svd.U().to_owned(), singular_values, outputs: p })
    }

    /// Returns A and C of the first `states` directions.
    pub fn shift(&self, states: usize) -> Result<(DMatrix<f64>, DMatrix<f64>), RefineError> {
        let (values, p) = (&self.singular_values, self.outputs);
        let rows = self.directions.nrows();
        let gamma = DMatrix::from_fn(rows, states, |row, k| self.directions[(row, k)] * values[k].sqrt());
        let (upper, lower) = (gamma.rows(0, rows - p), gamma.rows(p, rows - p));
        let a = upper
            .into_owned()
            .svd(true, true)
            .solve(&lower.into_owned(), RANK * values[0].sqrt())
            .map_err(|_| failed("the least-squares fit of A"))?;
        Ok((a, gamma.rows(0, p).into_owned()))
    }
}

fn failed(what: &'static str) -> RefineError {
    RefineError::Decomposition { what }
}

/// Returns the triangular factor R of the windows' rows.
fn triangle(data: &Data, i: usize) -> Result<Mat<f64>, RefineError> {
    let windows: Vec<(&Scaled, usize)> =
        data.records.iter().flat_map(|record| whole_windows(record, 2 * i).map(move |k| (record, k))).collect();
    let columns = 2 * i * (data.m() + data.p());
    if windows.len() < columns {
        return Err(RefineError::TooLittleData {
            purpose: "the subspace estimate",
            unit: "windows without a gap",
            needed: columns,
            available: windows.len(),
        });
    }
    let share = windows.len().div_ceil(PARTS);
    let parts: Vec<Mat<f64>> = windows.par_chunks(share).map(|part| part_triangle(part, i, columns)).collect();
    let all: usize = parts.iter().map(Mat::nrows).sum();
    let mut stacked = Mat::zeros(all, columns);
    let mut at = 0;
    for part in &parts {
        stacked.subrows_mut(at, part.nrows()).copy_from(part);
        at += part.nrows();
    }
    Ok(stacked.qr().thin_R().to_owned())
}

fn part_triangle(windows: &[(&Scaled, usize)], i: usize, columns: usize) -> Mat<f64> {
    let mut stacked = Mat::<f64>::zeros((1 + BLOCK) * columns, columns);
    let mut filled = 0;
    let reduce = |stacked: &mut Mat<f64>, filled: &mut usize| {
        let rows: MatRef<'_, f64> = stacked.subrows(0, *filled);
        let factor = rows.qr().thin_R().to_owned();
        *filled = factor.nrows();
        stacked.subrows_mut(0, *filled).copy_from(&factor);
    };
    for &(record, k) in windows {
        if filled == stacked.nrows() {
            reduce(&mut stacked, &mut filled);
        }
        let mut column = 0;
        let halves = [(&record.inputs, k + i), (&record.inputs, k), (&record.outputs, k), (&record.outputs, k + i)];
        for (array, from) in halves {
            for row in from..from + i {
                for &x in array.row(row) {
                    stacked[(filled, column)] = x;
                    column += 1;
                }
            }
        }
        filled += 1;
    }
    reduce(&mut stacked, &mut filled);
    stacked.subrows(0, filled).to_owned()
}

/// Returns the first samples of the windows of `length` samples in which no output is missing.
fn whole_windows(record: &Scaled, length: usize) -> impl Iterator<Item = usize> + '_ {
    let mut whole = 0;
    record.outputs.rows().into_iter().enumerate().filter_map(move |(k, y)| {
        whole = if y.iter().any(|y| y.is_nan()) { 0 } else { whole + 1 };
        (whole >= length).then(|| k + 1 - length)
    })
}
