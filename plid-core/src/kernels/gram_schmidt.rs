//! Thornton's weighted Gram-Schmidt method. The array is processed by columns, so no sum goes across a register.

use super::{Pack, dot};
use crate::{Scalar, View, ViewMut};

/// The nonzero columns of each row of an array, in two ranges. The first range ends at `middle`, the second at the
/// end of the array. Row i and the rows below it have no entries outside the ranges that begin at `starts[i]`.
#[derive(Clone, Copy, Debug)]
pub struct Support<'a> {
    /// The first columns of the two ranges of each row.
    pub starts: &'a [[usize; 2]],
    /// The end of the first range.
    pub middle: usize,
}

impl Support<'_> {
    /// Returns the ranges of row i in an array with this number of columns.
    #[inline(always)]
    fn ranges(&self, i: usize, columns: usize) -> [std::ops::Range<usize>; 2] {
        let [first, second] = self.starts[i];
        [first..self.middle, second..columns]
    }
}

#[inline(always)]
pub fn weighted_gram_schmidt<S: Scalar>(
    mut w: ViewMut<'_, S>,
    support: Support<'_>,
    weights: &[S],
    mut u: ViewMut<'_, S>,
    d: &mut [S],
    work: &mut [S],
) {
    let (n, rows, columns) = (d.len(), w.rows(), w.columns());
    let smallest = S::from_f64(S::SMALLEST / (S::EPSILON * S::EPSILON));
    // The last row that is done, the current row, the row after it, and the current row times the weights.
    let (mut done, rest) = work.split_at_mut(columns);
    let (mut row, rest) = rest.split_at_mut(columns);
    let (mut next, rest) = rest.split_at_mut(columns);
    let (weighted, factors) = rest.split_at_mut(columns);
    let factors = &mut factors[..rows];
    for zeros in [&mut *done, &mut *row, &mut *next, &mut *weighted, &mut *factors] {
        zeros.fill(S::zero());
    }
    // Row j is made orthogonal to the rows below it. The sweep that subtracts row j + 1 from the rows above then also
    // forms their products with row j, and copies row j - 1, which is processed next.
    for j in (0..n).rev() {
        let before = if j + 1 < n { support.starts[j + 1] } else { [support.middle, columns] };
        for (range, before) in support.ranges(j, columns).into_iter().zip(before) {
            // Columns that no sweep has reached yet.
            for c in range.start..before {
                row[c] = w.at(j, c);
            }
            let (row, done, weights) = (&mut row[range.clone()], &done[range.clone()], &weights[range.clone()]);
            for (((x, &below), &weight), product) in row.iter_mut().zip(done).zip(weights).zip(&mut weighted[range]) {
                *x = below.mul_add(-factors[j], *x);
                *product = *x * weight;
            }
        }
        d[j] = dot(weighted, row);
        // Products near underflow have few digits, and a direction formed from them would spoil the rows above.
        if d[j] <= smallest {
            d[j] = S::zero();
            weighted.fill(S::zero());
        }
        // Rows from j on remain unchanged.
        factors[j..].fill(S::zero());
        let mut at = 0;
        while at < j {
            let sweep = Sweep { ranges: support.ranges(j, columns), done, weighted, next_row: j - 1 };
            let w = w.reborrow();
            at += match rows - at {
                32.. if j - at > 16 => sweep.take::<32>(w, at, factors, next),
                16.. => sweep.take::<16>(w, at, factors, next),
                8.. => sweep.take::<8>(w, at, factors, next),
                _ => sweep.take::<1>(w, at, factors, next),
            };
        }
        for factor in &mut factors[..j] {
            *factor = if d[j] == S::zero() { S::zero() } else { *factor / d[j] };
        }
        let column = u.column_mut(j);
        column.fill(S::zero());
        column[..j].copy_from_slice(&factors[..j]);
        column[j] = S::one();
        (done, row, next) = (row, next, done);
    }
}

/// One sweep over the rows of the array.
struct Sweep<'a, S> {
    ranges: [std::ops::Range<usize>; 2],
    done: &'a [S],
    weighted: &'a [S],
    next_row: usize,
}

impl<S: Scalar> Sweep<'_, S> {
    /// Subtracts `factors` times the row `done` from rows at .. at + W of the array, and replaces the factors by the
    /// products of these rows with `weighted`. If the next row is one of these, `next` receives what is left of it.
    /// Returns W.
    #[inline(always)]
    fn take<const W: usize>(&self, mut w: ViewMut<'_, S>, at: usize, factors: &mut [S], next: &mut [S]) -> usize {
        let factor = Pack::<S, W>::load(&factors[at..]);
        let mut products = Pack::<S, W>::zero();
        // The last call of a sweep contains the next row, and overwrites what the earlier calls have written to
        // `next`.
        let lane = (self.next_row - at).min(W - 1);
        for range in self.ranges.clone() {
            let rows = (&self.done[range.clone()], &self.weighted[range.clone()], &mut next[range.clone()]);
            for (((c, &done), &weighted), next) in range.zip(rows.0).zip(rows.1).zip(rows.2) {
                let entries = &mut w.column_mut(c)[at..at + W];
                let x = Pack::load(entries).add_scaled(factor, -done);
                x.store(entries);
                *next = entries[lane];
                products = products.add_scaled(x, weighted);
            }
        }
        products.store(&mut factors[at..]);
        W
    }
}

/// Computes Q = V diag(d) V^T with V unit upper triangular, from the last row up and from the stored lower triangle
/// of Q. V is written to `v`, whose rows from n on become zero. A pivot of at most `zero` times its diagonal entry
/// (or not a number) becomes zero, and so does its column of V.
#[inline(always)]
pub fn upper_ldl<S: Scalar>(q: View<'_, S>, mut v: ViewMut<'_, S>, d: &mut [S], zero: S, work: &mut [S]) {
    let (n, rows) = (q.rows(), v.rows());
    for j in (0..n).rev() {
        let (mut left, right) = v.reborrow().split_at_column(j + 1);
        let column = left.column_mut(j);
        for (i, x) in column.iter_mut().enumerate() {
            *x = if i <= j { q.at(j, i) } else { S::zero() };
        }
        let diagonal = column[j];
        for (c, factor) in work[..n - j - 1].iter_mut().enumerate() {
            *factor = -right.at(j, c) * d[j + 1 + c];
        }
        let mut at = 0;
        while at <= j {
            at += match rows - at {
                32.. => add_columns::<S, 32>(right.view(), work, at, column),
                16.. => add_columns::<S, 16>(right.view(), work, at, column),
                8.. => add_columns::<S, 8>(right.view(), work, at, column),
                _ => add_columns::<S, 1>(right.view(), work, at, column),
            };
        }
        let pivot = column[j];
        column[j + 1..].fill(S::zero());
        if pivot > zero * diagonal {
            d[j] = pivot;
            column[..j].iter_mut().for_each(|x| *x /= pivot);
            column[j] = S::one();
        } else {
            d[j] = S::zero();
            column[..=j].fill(S::zero());
        }
    }
}

/// Adds rows at .. at + W of the weighted sum of the columns of `v` to `to`. Returns W.
#[inline(always)]
fn add_columns<S: Scalar, const W: usize>(v: View<'_, S>, weights: &[S], at: usize, to: &mut [S]) -> usize {
    let mut sum = Pack::<S, W>::load(&to[at..]);
    for c in 0..v.columns() {
        sum = sum.add_scaled(Pack::load(&v.column(c)[at..]), weights[c]);
    }
    sum.store(&mut to[at..]);
    W
}
