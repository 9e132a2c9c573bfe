//! The information of a record about a model, as inner products of a small set of signals.
//!
//! The output, its residual and their derivatives with respect to all parameters are linear combinations, with constant
//! weights, of the inputs and of the following signals of each section with denominator q(z) = (z - c)^2 - d:
//!
//! - (z - c)/q and 1/q applied to each input;
//! - (z - c)/q and 1/q applied to each of the two states of the section, which are themselves combinations of the
//!   former;
//! - if the initial state is unknown, the same filters applied to an impulse: A_s^k = alpha_k I + gamma_k (A_s - c I).
//!
//! The record is therefore represented by the matrix of inner products of these signals and the residuals, which is
//! the same for all outputs that are present at the same samples. Its computation costs O(K q^2), where q = sections
//! x (2 m + 4 or 6) + m + p, instead of a Jacobian for each output. The signals are computed in blocks of samples and
//! never stored as a whole.

use std::ops::Range;

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use crate::record::{Scaled, Start};
use crate::sections::{Section, Sections};

/// Samples in a block, chosen so that its signals roughly fit into the second-level cache.
const BLOCK: usize = 512;
/// Number of columns of the product that one task computes.
const PANEL: usize = 64;

/// The index of each signal in the matrix of products.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Places {
    pub m: usize,
    pub p: usize,
    pub sections: usize,
    pub free: bool,
}

impl Places {
    /// Returns the number of signals of a section.
    pub fn width(&self) -> usize {
        2 * self.m + if self.free { 6 } else { 4 }
    }

    /// Returns the index of the first of the two signals of a driver: an input j, `self.m` and `self.m + 1` for the
    /// states, or `self.m + 2` for the impulse.
    pub fn of(&self, section: usize, driver: usize) -> usize {
        section * self.width() + 2 * driver
    }

    pub fn input(&self, j: usize) -> usize {
        self.sections * self.width() + j
    }

    pub fn residual(&self, i: usize) -> usize {
        self.input(self.m) + i
    }

    pub fn count(&self) -> usize {
        self.residual(self.p)
    }
}

/// Inner products of the signals over the samples at which the outputs of a group are present.
#[derive(Debug)]
pub(crate) struct Gram {
    pub outputs: Vec<usize>,
    /// A symmetric matrix of size `Places::count`.
    pub products: DMatrix<f64>,
}

/// Groups the outputs that are missing at the same samples.
fn groups(record: &Scaled) -> Vec<Vec<usize>> {
    let mut groups: Vec<Vec<usize>> = Vec::new();
    let alike = |a: usize, b: usize| {
        let (a, b) = (record.outputs.column(a), record.outputs.column(b));
        a.iter().zip(b).all(|(a, b)| a.is_nan() == b.is_nan())
    };
    for i in 0..record.outputs.ncols() {
        match groups.iter_mut().find(|group| alike(group[0], i)) {
            Some(group) => group.push(i),
            None => groups.push(vec![i]),
        }
    }
    groups
}

/// The states of the filters of a section (two each), and the two states of the section itself.
struct Filters {
    section: Section,
    lanes: Vec<[f64; 2]>,
    state: [f64; 2],
}

impl Filters {
    fn of(model: &Sections, s: usize, initial: Option<&DVector<f64>>, m: usize) -> Self {
        let mut lanes = vec![[0.0; 2]; m + 2];
        if initial.is_some() {
            lanes.push([1.0, 0.0]);
        }
        let state = initial.map_or([0.0; 2], |x| [x[2 * s], x[2 * s + 1]]);
        Self { section: model.poles[s], lanes, state }
    }

    /// Computes the signals of `range` into `signals` (columns of BLOCK) and the states into `states` (two columns).
    fn fill(
        &mut self,
        record: &Scaled,
        model: &Sections,
        s: usize,
        range: Range<usize>,
        signals: &mut [f64],
        states: &mut [f64],
    ) {
        let Section { c, d, up } = self.section;
        let down = self.section.down();
        let m = model.m();
        for (row, k) in range.enumerate() {
            let u = record.inputs.row(k);
            let [x1, x2] = self.state;
            states[row] = x1;
            states[BLOCK + row] = x2;
            let mut next = [c * x1 + up * x2, down * x1 + c * x2];
            for (j, lane) in self.lanes.iter_mut().enumerate() {
                let [w1, w2] = *lane;
                signals[2 * j * BLOCK + row] = w1;
                signals[(2 * j + 1) * BLOCK + row] = w2;
                let driver = match j.checked_sub(m) {
                    None => u[j],
                    Some(0) => x1,
                    Some(1) => x2,
                    Some(_) => 0.0,
                };
                *lane = [c * w1 + d * w2 + driver, w1 + c * w2];
            }
            for j in 0..m {
                next[0] += model.b[(2 * s, j)] * u[j];
                next[1] += model.b[(2 * s + 1, j)] * u[j];
            }
            self.state = next;
        }
    }
}

/// The signals, divided into panels. One task sums the inner products of each pair of panels.
struct Panels {
    /// The number of signals.
    count: usize,
    columns: Vec<Range<usize>>,
    /// Pairs of panels in the lower triangle.
    pairs: Vec<(usize, usize)>,
}

impl Panels {
    fn of(count: usize) -> Self {
        let columns: Vec<Range<usize>> = (0..count).step_by(PANEL).map(|at| at..(at + PANEL).min(count)).collect();
        let pairs = (0..columns.len()).flat_map(|i| (0..=i).map(move |j| (i, j))).collect();
        Self { count, columns, pairs }
    }

    /// Returns one zero sum for each pair.
    fn zeros(&self) -> Vec<DMatrix<f64>> {
        let sum = |&(i, j): &(usize, usize)| DMatrix::zeros(self.columns[i].len(), self.columns[j].len());
        self.pairs.iter().map(sum).collect()
    }

    /// Adds the inner products over the first `rows` rows of `block` (BLOCK x signals).
    fn accumulate(&self, block: &[f64], rows: usize, sums: &mut [DMatrix<f64>]) {
        // Each sum belongs to a single task, so the result is identical for any number of threads.
        sums.par_iter_mut().zip(&self.pairs).for_each(|(sum, &(i, j))| {
            let view = |panel: &Range<usize>| {
                let columns = &block[panel.start * BLOCK..panel.end * BLOCK];
                MatRef::from_column_major_slice(columns, BLOCK, panel.len()).subrows(0, rows)
            };
            let (left, right) = (view(&self.columns[i]), view(&self.columns[j]));
            let (height, breadth) = sum.shape();
            let to = MatMut::from_column_major_slice_mut(sum.as_mut_slice(), height, breadth);
            matmul(to, Accum::Add, left.transpose(), right, 1.0, Par::Seq);
        });
    }

    /// Returns the symmetric matrix of all inner products.
    fn assemble(&self, sums: Vec<DMatrix<f64>>) -> DMatrix<f64> {
        let mut products = DMatrix::zeros(self.count, self.count);
        for (&(i, j), sum) in self.pairs.iter().zip(&sums) {
            let (rows, columns) = (&self.columns[i], &self.columns[j]);
            products.view_mut((rows.start, columns.start), sum.shape()).copy_from(sum);
            let transposed = sum.transpose();
            products.view_mut((columns.start, rows.start), transposed.shape()).copy_from(&transposed);
        }
        products
    }
}

/// Computes the inner products of signals and residuals for one record; `initial` is `None` for a start at rest.
pub(crate) fn gram(record: &Scaled, model: &Sections, initial: Option<&DVector<f64>>) -> Vec<Gram> {
    let places = places(record, model);
    let (count, width, m) = (places.count(), places.width(), places.m);
    let mut filters: Vec<Filters> = (0..places.sections).map(|s| Filters::of(model, s, initial, m)).collect();
    let mut signals = vec![0.0; count * BLOCK];
    let mut states = vec![0.0; 2 * places.sections * BLOCK];
    let panels = Panels::of(count);
    let groups = groups(record);
    let mut sums: Vec<Vec<DMatrix<f64>>> = groups.iter().map(|_| panels.zeros()).collect();
    let samples = record.inputs.nrows();
    let mut packed = vec![0.0; count * BLOCK];
    for from in (0..samples).step_by(BLOCK) {
        let range = from..(from + BLOCK).min(samples);
        let of_sections = &mut signals[..places.sections * width * BLOCK];
        filters
            .par_iter_mut()
            .zip(of_sections.par_chunks_mut(width * BLOCK))
            .zip(states.par_chunks_mut(2 * BLOCK))
            .enumerate()
            .for_each(|(s, ((filter, signals), states))| filter.fill(record, model, s, range.clone(), signals, states));
        for j in 0..m {
            for (row, k) in range.clone().enumerate() {
                signals[places.input(j) * BLOCK + row] = record.inputs[(k, j)];
            }
        }
        residuals(record, model, &range, &states, &mut signals[places.residual(0) * BLOCK..]);
        for (group, sums) in groups.iter().zip(&mut sums) {
            let rows: Vec<usize> = range
                .clone()
                .enumerate()
                .filter(|(_, k)| !record.outputs[(*k, group[0])].is_nan())
                .map(|(row, _)| row)
                .collect();
            let block = if rows.len() == range.len() {
                &signals
            } else {
                for (column, to) in signals.chunks(BLOCK).zip(packed.chunks_mut(BLOCK)) {
                    rows.iter().zip(to).for_each(|(&row, to)| *to = column[row]);
                }
                &packed
            };
            panels.accumulate(block, rows.len(), sums);
        }
    }
    groups.into_iter().zip(sums).map(|(outputs, sums)| Gram { outputs, products: panels.assemble(sums) }).collect()
}

pub(crate) fn places(record: &Scaled, model: &Sections) -> Places {
    let free = record.start == Start::Unknown;
    Places { m: model.m(), p: model.p(), sections: model.poles.len(), free }
}

/// Computes y - C x - D u for the samples of `range`, one column of BLOCK per output; it is zero where y is missing.
fn residuals(record: &Scaled, model: &Sections, range: &Range<usize>, states: &[f64], to: &mut [f64]) {
    let rows = range.len();
    for i in 0..model.p() {
        let error = &mut to[i * BLOCK..i * BLOCK + rows];
        for (e, k) in error.iter_mut().zip(range.clone()) {
            *e = record.outputs[(k, i)];
        }
        for (column, c) in states.chunks(BLOCK).zip(model.c.row(i).iter()) {
            error.iter_mut().zip(column).for_each(|(e, x)| *e -= c * x);
        }
        if model.feedthrough {
            for (e, k) in error.iter_mut().zip(range.clone()) {
                *e -= (0..model.m()).map(|j| model.d[(i, j)] * record.inputs[(k, j)]).sum::<f64>();
            }
        }
        error.iter_mut().filter(|e| e.is_nan()).for_each(|e| *e = 0.0);
    }
}

/// Returns the sum of squared residuals of each output, without derivatives.
pub(crate) fn squares(record: &Scaled, model: &Sections, initial: Option<&DVector<f64>>) -> Vec<f64> {
    let mut sums = vec![0.0; model.p()];
    let mut states: Vec<[f64; 2]> =
        (0..model.poles.len()).map(|s| initial.map_or([0.0; 2], |x| [x[2 * s], x[2 * s + 1]])).collect();
    let mut columns = vec![0.0; 2 * states.len() * BLOCK];
    let mut errors = vec![0.0; model.p() * BLOCK];
    let (samples, m) = (record.inputs.nrows(), model.m());
    for from in (0..samples).step_by(BLOCK) {
        let range = from..(from + BLOCK).min(samples);
        for (s, (state, columns)) in states.iter_mut().zip(columns.chunks_mut(2 * BLOCK)).enumerate() {
            let Section { c, up, .. } = model.poles[s];
            let down = model.poles[s].down();
            for (row, k) in range.clone().enumerate() {
                let [x1, x2] = *state;
                columns[row] = x1;
                columns[BLOCK + row] = x2;
                let mut next = [c * x1 + up * x2, down * x1 + c * x2];
                for j in 0..m {
                    let u = record.inputs[(k, j)];
                    next[0] += model.b[(2 * s, j)] * u;
                    next[1] += model.b[(2 * s + 1, j)] * u;
                }
                *state = next;
            }
        }
        residuals(record, model, &range, &columns, &mut errors);
        for (sum, error) in sums.iter_mut().zip(errors.chunks(BLOCK)) {
            *sum += error[..range.len()].iter().map(|e| e * e).sum::<f64>();
        }
    }
    sums
}
