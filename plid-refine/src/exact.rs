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
    let (b, d, initial_states) = inputs(&data, &a, &c, feedthrough);
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

/// B (n x m), D (p x m) and the state at the first sample of each record.
fn inputs(
    data: &Data,
    a: &DMatrix<f64>,
    c: &DMatrix<f64>,
    feedthrough: bool,
) -> (DMatrix<f64>, DMatrix<f64>, Vec<DVector<f64>>) {
    let (n, m, p) = (a.nrows(), data.m(), data.p());
    let of_d = if feedthrough { p * m } else { 0 };
    let unknown = |record: &&Scaled| record.start == Start::Unknown;
    let width = n * m + of_d + n * data.records.iter().filter(unknown).count();
    let mut rows: Vec<(Vec<f64>, f64)> = Vec::new();
    let mut first = n * m + of_d;
    for record in &data.records {
        // What the state is for a unit of each entry of B, and of the initial state: n x (n m + n).
        let mut state = DMatrix::zeros(n, n * m + n);
        state.columns_mut(n * m, n).fill_with_identity();
        for k in 0..record.outputs.nrows().min(SAMPLES) {
            let seen = c * &state;
            for i in (0..p).filter(|&i| record.outputs[(k, i)].is_finite()) {
                let mut row = vec![0.0; width];
                (0..n * m).for_each(|column| row[column] = seen[(i, column)]);
                (0..m).filter(|_| feedthrough).for_each(|j| row[n * m + i * m + j] = record.inputs[(k, j)]);
                if record.start == Start::Unknown {
                    (0..n).for_each(|column| row[first + column] = seen[(i, n * m + column)]);
                }
                rows.push((row, record.outputs[(k, i)]));
            }
            state = a * state;
            for j in 0..m {
                (0..n).for_each(|i| state[(i, j * n + i)] += record.inputs[(k, j)]);
            }
        }
        first += if record.start == Start::Unknown { n } else { 0 };
    }
    // Columns of like size; what nothing drives stays zero.
    let size =
        |column: usize| rows.iter().map(|(row, _)| row[column].powi(2)).sum::<f64>().sqrt().max(f64::MIN_POSITIVE);
    let sizes: Vec<f64> = (0..width).map(size).collect();
    let matrix = Mat::from_fn(rows.len(), width, |k, column| rows[k].0[column] / sizes[column]);
    let wanted = Mat::from_fn(rows.len(), 1, |k, _| rows[k].1);
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
    (b, d, data.records.iter().map(&mut start).collect())
}
