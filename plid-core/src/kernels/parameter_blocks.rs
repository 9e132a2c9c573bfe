//! Sums of blocks of U diag(d) U^T between parameter columns.

use super::{Pack, PanelLayout};
use crate::{Scalar, View, ViewMut};

/// The number of columns that are gathered before their squares are added to the sum: few enough for them to stay in
/// the first-level cache.
pub const DEPTH: usize = 32;

/// The number of columns of the sum that are formed at a time.
const TILE: usize = 8;

#[inline(always)]
#[allow(clippy::too_many_arguments)]
pub fn add_parameter_blocks<S: Scalar>(
    layout: PanelLayout,
    theta: View<'_, S>,
    d: &[S],
    factor: View<'_, S>,
    from: usize,
    to: usize,
    mut sum: ViewMut<'_, S>,
    mut work: ViewMut<'_, S>,
) {
    let (n, rows) = (layout.n(), layout.rows());
    let mut c = from;
    while c < to {
        // At most DEPTH columns, all of one block.
        let block = c / n;
        let end = to.min((block + 1) * n);
        let taken = (end - c).min(DEPTH);
        let mut roots = [S::zero(); DEPTH];
        for (root, &d) in roots.iter_mut().zip(&d[c..c + taken]) {
            *root = d.sqrt();
        }
        for k in 0..factor.columns() {
            let weights = factor.column(k);
            let Some(first) = weights.iter().position(|&x| x != S::zero()) else { continue };
            if first > block {
                continue;
            }
            // If this is the diagonal block of the only panel that contributes, the rows below the diagonal are zero.
            let triangle = first == block;
            let step = if triangle { DEPTH / 2 } else { DEPTH };
            for part in (0..taken).step_by(step) {
                let width = step.min(taken - part);
                let last = c + part + width - block * n;
                let filled = if triangle { rows.min(last.next_multiple_of(TILE)) } else { rows };
                for q in 0..width {
                    let (column, root) = (c + part + q, roots[part + q]);
                    gather(layout, theta, &weights[..=block], first, column, root, filled, work.column_mut(q));
                }
                add_squares(work.view().block(0, 0, rows, width), filled, sum.reborrow());
            }
        }
        c += taken;
    }
}

/// Writes the weighted sum of a column's parts in the panels from `first` on, times `root`, to `to`.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
fn gather<S: Scalar>(
    layout: PanelLayout,
    theta: View<'_, S>,
    weights: &[S],
    first: usize,
    c: usize,
    root: S,
    filled: usize,
    to: &mut [S],
) {
    let mut at = 0;
    while at < filled {
        at += match filled - at {
            32.. => gather_rows::<S, 32>(layout, theta, weights, first, c, root, at, to),
            16.. => gather_rows::<S, 16>(layout, theta, weights, first, c, root, at, to),
            _ => gather_rows::<S, 8>(layout, theta, weights, first, c, root, at, to),
        };
    }
}

/// Writes rows at .. at + W of this sum. Returns W.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
fn gather_rows<S: Scalar, const W: usize>(
    layout: PanelLayout,
    theta: View<'_, S>,
    weights: &[S],
    first: usize,
    c: usize,
    root: S,
    at: usize,
    to: &mut [S],
) -> usize {
    let mut sum = Pack::<S, W>::zero();
    for s in first..weights.len() {
        // Diagonal weights have only one nonzero term.
        if weights[s] != S::zero() {
            let place = layout.column(s + 1, layout.n() + c) - layout.start(1);
            sum = sum.add_scaled(Pack::load(&theta.column(place)[at..]), weights[s]);
        }
    }
    sum.scaled(root).store(&mut to[at..]);
    W
}

/// Computes SUM <- SUM + V V^T, lower triangle, from the first `filled` rows of V; the other rows are zero.
#[inline(always)]
fn add_squares<S: Scalar>(v: View<'_, S>, filled: usize, mut sum: ViewMut<'_, S>) {
    for j in (0..filled).step_by(TILE) {
        let mut i = j;
        while i < filled {
            i += match filled - i {
                24.. => add_tile::<S, 24>(v, i, j, sum.reborrow()),
                16.. => add_tile::<S, 16>(v, i, j, sum.reborrow()),
                _ => add_tile::<S, 8>(v, i, j, sum.reborrow()),
            };
        }
    }
}

/// Updates rows i .. i + W and columns j .. j + TILE of the sum in registers. Returns W.
#[inline(always)]
fn add_tile<S: Scalar, const W: usize>(v: View<'_, S>, i: usize, j: usize, mut sum: ViewMut<'_, S>) -> usize {
    // Each pack has a name of its own, because the compiler would place an array of packs in memory.
    let load = |q: usize| Pack::<S, W>::load(&sum.column(j + q)[i..]);
    let (mut t0, mut t1, mut t2, mut t3) = (load(0), load(1), load(2), load(3));
    let (mut t4, mut t5, mut t6, mut t7) = (load(4), load(5), load(6), load(7));
    for c in 0..v.columns() {
        let column = v.column(c);
        let left = Pack::<S, W>::load(&column[i..]);
        let right = &column[j..j + TILE];
        t0 = t0.add_scaled(left, right[0]);
        t1 = t1.add_scaled(left, right[1]);
        t2 = t2.add_scaled(left, right[2]);
        t3 = t3.add_scaled(left, right[3]);
        t4 = t4.add_scaled(left, right[4]);
        t5 = t5.add_scaled(left, right[5]);
        t6 = t6.add_scaled(left, right[6]);
        t7 = t7.add_scaled(left, right[7]);
    }
    for (q, tile) in [t0, t1, t2, t3, t4, t5, t6, t7].into_iter().enumerate() {
        tile.store(&mut sum.column_mut(j + q)[i..]);
    }
    W
}
