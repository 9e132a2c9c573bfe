//! Exact identification of a linear system from noise-free records, such as the outputs of a simulator.
//!
//! Without noise the singular values of the windows (`subspace.rs`) drop to rounding level beyond the order of the
//! system. A and C are obtained in the basis of the observable directions, in which equal poles (such as those of
//! identical filters at the outputs) keep separate directions; blocks of two poles would make them nearly parallel. B,
//! D and the initial states are fitted to the first samples of each record by orthogonal least squares, because normal
//! equations would lose the fast filters, whose contribution to the outputs is about a millionth.

use faer::Mat;
use faer::prelude::SolveLstsq;
use nalgebra::{DMatrix, DVector};
use plid_model::Model;

use crate::error::RefineError;
use crate::record::{Data, Record, Scaled, Start};
use crate::subspace::{RANK, Window};

/// Beyond the order of a noise-free system the singular values drop by more than this factor, to rounding level, even
/// for data with seven digits. With noise they drop by a small factor only.
const FALL: f64 = 1e3;
/// Half the window, as a multiple of the samples needed for `most_states` directions.
const DEPTH: usize = 3;
/// Number of samples of each record to which B, D and the initial states are fitted.
const SAMPLES: usize = 1000;

/// A linear system with the initial states of its records.
#[derive(Clone, Debug)]
pub struct Exact {
    /// The model, with channels named u1, u2, ... and y1, y2, ...
    pub model: Model,
    /// State at the first sample of each record.
    pub initial_states: Vec<DVector<f64>>,
}

/// Identifies the linear system of up to about `most_states` states that generated noise-free records. Returns `None`
/// if the records do not determine its order, or if a pole lies on or outside the unit circle. The caller must check
/// the fit, because the singular values of a nonlinear system may also drop.
///
/// # Errors
/// Returns a [`RefineError`] for records that are empty, inconsistent or not finite, and if there are too few windows
/// without a gap.
pub fn exact(
    records: &[Record<'_>],
    most_states: usize,
    feedthrough: bool,
    sample_rate_hz: f64,
) -> Result<Option<Exact>, RefineError> {
    let data = Data::new(records)?;
    let window = Window::new(&data, (DEPTH * most_states).div_ceil(data.p()).max(10))?;
    let Some(states) = order(&window.singular_values) else { return Ok(None) };
    let (a, c) = window.shift(states)?;
    let poles = Mat::from_fn(states, states, |i, j| a[(i, j)]).eigenvalues();
    let poles = poles.map_err(|_| RefineError::Decomposition { what: "the eigenvalues of A" })?;
    if poles.iter().any(|z| z.norm() >= 1.0) {
        return Ok(None);
    }
    let Some(Driven { b, d, initial_states }) = driven(&data, &a, &c, feedthrough) else { return Ok(None) };
    let scale = |i: usize, j: usize| data.output_scale[i] / data.input_scale[j];
    let b = DMatrix::from_fn(states, data.m(), |i, j| b[(i, j)] / data.input_scale[j]);
    let c = DMatrix::from_fn(data.p(), states, |i, j| c[(i, j)] * data.output_scale[i]);
    let d = DMatrix::from_fn(data.p(), data.m(), |i, j| d[(i, j)] * scale(i, j));
    Ok(Some(Exact { model: Model::new(sample_rate_hz, a, b, c, d)?, initial_states }))
}

/// Returns the order according to the singular values (in decreasing order), or `None` if they do not drop to rounding
/// level.
fn order(singular_values: &[f64]) -> Option<usize> {
    let rounding = RANK * singular_values.first()?;
    let falls = singular_values.windows(2).map(|pair| pair[0].max(rounding) / pair[1].max(rounding));
    let (last, fall) = falls.enumerate().max_by(|a, b| a.1.total_cmp(&b.1))?;
    (fall > FALL).then_some(last + 1)
}

/// The input matrices and initial states of a system in scaled channels.
struct Driven {
    /// Input matrix (n x m).
    b: DMatrix<f64>,
    /// Feedthrough matrix (p x m).
    d: DMatrix<f64>,
    /// State at the first sample of each record.
    initial_states: Vec<DVector<f64>>,
}

/// Fits B, D and the initial states, or returns `None` if there are fewer samples than unknowns.
fn driven(data: &Data, a: &DMatrix<f64>, c: &DMatrix<f64>, feedthrough: bool) -> Option<Driven> {
    let (n, m, p) = (a.nrows(), data.m(), data.p());
    let of_d = if feedthrough { p * m } else { 0 };
    let unknown = |record: &&Scaled| record.start == Start::Unknown;
    let width = n * m + of_d + n * data.records.iter().filter(unknown).count();
    let head = |record: &Scaled| record.outputs.nrows().min(SAMPLES);
    let seen = |record: &Scaled| {
        record.outputs.rows().into_iter().take(head(record)).flatten().filter(|y| y.is_finite()).count()
    };
    let rows: usize = data.records.iter().map(seen).sum();
    if rows < width {
        return None;
    }
    let (mut matrix, mut wanted) = (Mat::zeros(rows, width), Mat::zeros(rows, 1));
    let (mut row, mut first) = (0, n * m + of_d);
    for record in &data.records {
        // Responses of the state to a unit value of each entry of B and of the initial state: n x (n m + n).
        let mut state = DMatrix::zeros(n, n * m + n);
        state.columns_mut(n * m, n).fill_with_identity();
        for k in 0..head(record) {
            let seen = c * &state;
            for i in (0..p).filter(|&i| record.outputs[(k, i)].is_finite()) {
                (0..n * m).for_each(|column| matrix[(row, column)] = seen[(i, column)]);
                (0..m).filter(|_| feedthrough).for_each(|j| matrix[(row, n * m + i * m + j)] = record.inputs[(k, j)]);
                if record.start == Start::Unknown {
                    (0..n).for_each(|column| matrix[(row, first + column)] = seen[(i, n * m + column)]);
                }
                wanted[(row, 0)] = record.outputs[(k, i)];
                row += 1;
            }
            state = a * state;
            for j in 0..m {
                (0..n).for_each(|i| state[(i, j * n + i)] += record.inputs[(k, j)]);
            }
        }
        first += if record.start == Start::Unknown { n } else { 0 };
    }
    // The columns are scaled to similar norms; the coefficient of a zero column remains zero.
    let sizes: Vec<f64> = (0..width).map(|column| matrix.col(column).norm_l2().max(f64::MIN_POSITIVE)).collect();
    for (column, size) in sizes.iter().enumerate() {
        (0..rows).for_each(|row| matrix[(row, column)] /= size);
    }
    let found = matrix.qr().solve_lstsq(&wanted);
    let value = |column: usize| found[(column, 0)] / sizes[column];
    let b = DMatrix::from_fn(n, m, |i, j| value(j * n + i));
    let d = DMatrix::from_fn(p, m, |i, j| if feedthrough { value(n * m + i * m + j) } else { 0.0 });
    let mut at = n * m + of_d;
    let mut start = |record: &Scaled| {
        let known = record.start == Start::Rest;
        at += if known { 0 } else { n };
        if known { DVector::zeros(n) } else { DVector::from_fn(n, |i, _| value(at - n + i)) }
    };
    Some(Driven { b, d, initial_states: data.records.iter().map(&mut start).collect() })
}
