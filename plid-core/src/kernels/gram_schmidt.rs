//! Thornton's weighted Gram-Schmidt, by columns of the array: no sum goes across a register.

use super::{Pack, dot};
use crate::{Scalar, View, ViewMut};

/// Two ranges of columns of an array, given by where each begins; the first one ends at `middle`, the second at the array's end.
/// Row i has no entries outside of those of `starts[i]`, nor have the rows below it.
#[derive(Clone, Copy, Debug)]
pub struct Support<'a> {
    /// Where the ranges of each row begin.
    pub starts: &'a [[usize; 2]],
    /// The end of the first range.
    pub middle: usize,
}

impl Support<'_> {
    /// The ranges of row i in an array of so many columns.
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
    // The last row that is done, the one that is being made, and that one weighted.
    let (mut done, rest) = work.split_at_mut(columns);
    let (mut row, rest) = rest.split_at_mut(columns);
    let (weighted, factors) = rest.split_at_mut(columns);
    let factors = &mut factors[..rows];
    done.fill(S::zero());
    row.fill(S::zero());
    weighted.fill(S::zero());
    factors.fill(S::zero());
    // Row j is made orthogonal to the rows below it. As soon as it is, the sweep that takes the row below it out of all
    // others forms their products with row j too.
    for j in (0..n).rev() {
        for range in support.ranges(j, columns) {
            for c in range {
                row[c] = done[c].mul_add(-factors[j], w.at(j, c));
                weighted[c] = row[c] * weights[c];
            }
        }
        d[j] = dot(weighted, row);
        // Products near underflow have few digits: a direction made of them would spoil the rows above.
        if d[j] <= smallest {
            d[j] = S::zero();
            weighted.fill(S::zero());
        }
        // Rows from j on are left as they are.
        factors[j..].fill(S::zero());
        let mut at = 0;
        while at < j {
            let w = w.reborrow();
            at += match rows - at {
                32.. if j - at > 16 => {
                    subtract_and_multiply::<S, 32>(w, support.ranges(j, columns), done, weighted, at, factors)
                }
                16.. => subtract_and_multiply::<S, 16>(w, support.ranges(j, columns), done, weighted, at, factors),
                8.. => subtract_and_multiply::<S, 8>(w, support.ranges(j, columns), done, weighted, at, factors),
                _ => subtract_and_multiply::<S, 1>(w, support.ranges(j, columns), done, weighted, at, factors),
            };
        }
        for factor in &mut factors[..j] {
            *factor = if d[j] == S::zero() { S::zero() } else { *factor / d[j] };
        }
        let column = u.column_mut(j);
        column.fill(S::zero());
        column[..j].copy_from_slice(&factors[..j]);
        column[j] = S::one();
        std::mem::swap(&mut done, &mut row);
    }
}

/// Takes `factors` times the row `done` off rows at .. at + W of the array, and puts their products with `weighted` in place
/// of the factors. Returns W.
#[inline(always)]
fn subtract_and_multiply<S: Scalar, const W: usize>(
    mut w: ViewMut<'_, S>,
    ranges: [std::ops::Range<usize>; 2],
    done: &[S],
    weighted: &[S],
    at: usize,
    factors: &mut [S],
) -> usize {
    let factor = Pack::<S, W>::load(&factors[at..]);
    let mut products = Pack::<S, W>::zero();
    for range in ranges {
        for c in range {
            let entries = &mut w.column_mut(c)[at..at + W];
            let x = Pack::load(entries).add_scaled(factor, -done[c]);
            x.store(entries);
            products = products.add_scaled(x, weighted[c]);
        }
    }
    products.store(&mut factors[at..]);
    W
}

/// Q = V diag(d) V^T with V unit upper triangular, from the last row up, by its stored lower triangle: V into `v`, rows from n on
/// zero. A pivot of at most `zero` times its diagonal entry (or not a number) is given as zero, and its column of V too.
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

/// Adds the weighted sum of the columns of `v`, rows at .. at + W of it, to `to`. Returns W.
#[inline(always)]
fn add_columns<S: Scalar, const W: usize>(v: View<'_, S>, weights: &[S], at: usize, to: &mut [S]) -> usize {
    let mut sum = Pack::<S, W>::load(&to[at..]);
    for c in 0..v.columns() {
        sum = sum.add_scaled(Pack::load(&v.column(c)[at..]), weights[c]);
    }
    sum.store(&mut to[at..]);
    W
}
