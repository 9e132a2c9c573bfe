//! The linear system behind records without noise: a simulator's own outputs.
//!
//! Without noise the singular values of the windows (`subspace.rs`) fall to rounding behind the order. A and C are those of the observable directions, where equal poles (a filter at
//! each output) keep directions of their own; in a block of two poles they would be nearly one. B, D and the initial states are fitted to the first samples of each
//! record by orthogonal least squares: normal equations would lose the fast filters, of which outputs have a millionth.

use faer::Mat;
use faer::prelude::SolveLstsq;
use nalgebra::{DMatrix, DVector};
use plid_model::Model;

use crate::error::RefineError;
use crate::record::{Data, Record, Scaled, Start};
use crate::subspace::{RANK, Window};

/// Behind the order the singular values fall at once by more than this: to rounding, even that of seven digits. Noise lets them fall by a few.
const FALL: f64 = 1e3;
/// Half the window holds so many times the directions of `most_states`.
const DEPTH: usize = 3;
/// Samples of each record that B, D and the initial states are fitted to.
const SAMPLES: usize = 1000;

/// A linear system and where its records begin.
#[derive(Clone, Debug)]
pub struct Exact {
    /// Channels are named u1.. and y1...
    pub model: Model,
    /// State at the first sample of each record.
    pub initial_states: Vec<DVector<f64>>,
}

/// The system of up to about `most_states` states that the records come from; none where they do not tell its order, or where a pole lies on or outside the circle. How
/// well it follows them has to be looked at: records of a system that is not linear may have a fall among the values too.
///
/// # Errors
/// [`RefineError`]: records that are empty, of other channels or not finite; too few windows without a gap.
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

/// The order that the singular values tell, largest first; none where they do not fall to rounding.
fn order(singular_values: &[f64]) -> Option<usize> {
    let rounding = RANK * singular_values.first()?;
    let falls = singular_values.windows(2).map(|pair| pair[0].max(rounding) / pair[1].max(rounding));
    let (last, fall) = falls.enumerate().max_by(|a, b| a.1.total_cmp(&b.1))?;
    (fall > FALL).then_some(last + 1)
}

/// How the records drive a system, in scaled channels.
struct Driven {
    /// n x m.
    b: DMatrix<f64>,
    /// p x m.
    d: DMatrix<f64>,
    /// State at the first sample of each record.
    initial_states: Vec<DVector<f64>>,
}

/// None from fewer samples than there are entries to find.
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
        // What the state is for a unit of each entry of B, and of the initial state: n x (n m + n).
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
    // Columns of like size; one that nothing drives stays zero.
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
