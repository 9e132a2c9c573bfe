//! A triangular factor by Householder reflections. The array is processed by columns, so no sum goes across a
//! register.

use super::{Pack, dot};
use crate::{Scalar, ViewMut};

/// The nonzero columns of each row of an array W (n x r). When row i is reflected, it has entries only in the columns
/// `starts[i]` .. `ends[i]` and in column r - n + i, into which it is reflected.
#[derive(Clone, Copy, Debug)]
pub struct Tails<'a> {
    /// The first column of each row.
    pub starts: &'a [usize],
    /// The end of the columns of each row.
    pub ends: &'a [usize],
}

#[inline(always)]
pub fn triangular_factor<S: Scalar>(
    mut w: ViewMut<'_, S>,
    n: usize,
    tails: Tails<'_>,
    mut s: ViewMut<'_, S>,
    work: &mut [S],
) {
    let (rows, columns) = (w.rows(), w.columns());
    // The last reflector, the next one, and the multiple of the last one that is subtracted from each row.
    let (mut last, rest) = work.split_at_mut(columns);
    let (mut next, factors) = rest.split_at_mut(columns);
    let factors = &mut factors[..rows];
    last.fill(S::zero());
    factors.fill(S::zero());
    let (mut last_start, mut last_end) = (0, 0);
    for j in (0..n).rev() {
        let (start, end, pivot) = (tails.starts[j], tails.ends[j], columns - n + j);
        next.fill(S::zero());
        for c in start..end {
            next[c] = last[c].mul_add(-factors[j], w.at(j, c));
        }
        next[pivot] = last[pivot].mul_add(-factors[j], w.at(j, pivot));
        let norm = dot(next, next).sqrt();
        // This sign avoids cancellation. The diagonal of S is then made positive by changing the sign of its column.
        // A row of zeros is not reflected.
        let head = next[pivot];
        let alpha = if head > S::zero() { -norm } else { norm };
        let scale = -(alpha * (head - alpha));
        if norm != S::zero() {
            next[pivot] = head - alpha;
        }
        let (from, to) = if last_start < last_end { (start.min(last_start), end.max(last_end)) } else { (start, end) };
        factors[j..].fill(S::zero());
        let mut at = 0;
        while at < j {
            let w = w.reborrow();
            let columns = [from..to, pivot.max(to)..pivot + 1];
            at += match rows - at {
                32.. if j - at > 16 => subtract_and_multiply::<S, 32>(w, columns, last, next, at, factors),
                16.. => subtract_and_multiply::<S, 16>(w, columns, last, next, at, factors),
                8.. => subtract_and_multiply::<S, 8>(w, columns, last, next, at, factors),
                _ => subtract_and_multiply::<S, 1>(w, columns, last, next, at, factors),
            };
        }
        // Column `pivot` is not used again: after its own reflection it is column j of S.
        let sign = if alpha < S::zero() { -S::one() } else { S::one() };
        let column = s.column_mut(j);
        column.fill(S::zero());
        column[j] = alpha * sign;
        for i in 0..j {
            factors[i] = if norm == S::zero() { S::zero() } else { factors[i] / scale };
            column[i] = next[pivot].mul_add(-factors[i], w.at(i, pivot)) * sign;
        }
        std::mem::swap(&mut last, &mut next);
        (last_start, last_end) = (start, end);
    }
}

/// Subtracts `factors` times the row `last` from rows at .. at + W of the array, and replaces the factors by the
/// products of these rows with `next`. Returns W.
#[inline(always)]
fn subtract_and_multiply<S: Scalar, const W: usize>(
    mut w: ViewMut<'_, S>,
    columns: [std::ops::Range<usize>; 2],
    last: &[S],
    next: &[S],
    at: usize,
    factors: &mut [S],
) -> usize {
    let factor = Pack::<S, W>::load(&factors[at..]);
    let mut products = Pack::<S, W>::zero();
    for range in columns {
        for c in range {
            let entries = &mut w.column_mut(c)[at..at + W];
            let x = Pack::load(entries).add_scaled(factor, -last[c]);
            x.store(entries);
            products = products.add_scaled(x, next[c]);
        }
    }
    products.store(&mut factors[at..]);
    W
}
