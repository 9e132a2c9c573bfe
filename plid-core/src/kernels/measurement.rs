//! Scalar measurement updates of a triangular factor, all of them in one sweep over the factor.
//!
//! Each of the p updates processes the columns of U from the first to the last, and changes column j by two numbers.
//! These follow from f_j, the entry of h U in this column after the previous updates. The row h U is transformed like
//! any other row of U. Therefore the p rows of H U are first taken through all updates (O(N p^2)), which gives the
//! numbers of all columns. All other rows are then independent of each other, and a group of rows is taken through
//! the columns once, with its p gains in registers.

use super::Pack;
use crate::{Scalar, View, ViewMut};

/// The effect of a scalar measurement update on one column.
pub trait ColumnPass<S: Scalar> {
    /// Returns the two numbers by which a column with the entry f of h U is changed. `spread` is the innovation's
    /// variance or its root, accumulated over the columns so far from that of the noise; `d` is the column's weight.
    /// Both are updated.
    fn enter(f: S, spread: &mut S, d: &mut S) -> [S; 2];

    /// Changes rows of the column, and the same rows of the gain times the spread, which is accumulated from zero.
    fn apply<const W: usize>(by: [S; 2], u: Pack<S, W>, gain: Pack<S, W>) -> (Pack<S, W>, Pack<S, W>);
}

/// Bierman's update of U D U^T.
pub struct Bierman;

impl<S: Scalar> ColumnPass<S> for Bierman {
    #[inline(always)]
    fn enter(f: S, variance: &mut S, d: &mut S) -> [S; 2] {
        let g = *d * f;
        let before = *variance;
        *variance = f.mul_add(g, before);
        if *variance == S::zero() {
            return [S::zero(); 2];
        }
        *d *= before / *variance;
        // If `before` is zero, the gain accumulated so far is zero, and so is its contribution.
        let lambda = if before == S::zero() { S::zero() } else { -f / before };
        [lambda, g]
    }

    #[inline(always)]
    fn apply<const W: usize>([lambda, g]: [S; 2], u: Pack<S, W>, gain: Pack<S, W>) -> (Pack<S, W>, Pack<S, W>) {
        (u.add_scaled(gain, lambda), gain.add_scaled(u, g))
    }
}

/// Givens rotations of [gain, S], which rotate f into the innovation's standard deviation and the column into the
/// gain.
pub struct Givens;

impl<S: Scalar> ColumnPass<S> for Givens {
    #[inline(always)]
    fn enter(f: S, deviation: &mut S, _d: &mut S) -> [S; 2] {
        if f == S::zero() {
            return [S::one(), S::zero()];
        }
        let length = hypotenuse(*deviation, f);
        let (c, s) = (*deviation / length, f / length);
        *deviation = length;
        [c, s]
    }

    /// Applies the rotation directly. Shears need one multiply-add less, but for angles near a right angle they lose
    /// what is left of the column.
    #[inline(always)]
    fn apply<const W: usize>([c, s]: [S; 2], u: Pack<S, W>, gain: Pack<S, W>) -> (Pack<S, W>, Pack<S, W>) {
        (u.scaled(c).add_scaled(gain, -s), gain.scaled(c).add_scaled(u, s))
    }
}

/// Returns the length of (a, b) without overflow.
#[inline(always)]
pub fn hypotenuse<S: Scalar>(a: S, b: S) -> S {
    let largest = a.abs().max(b.abs());
    if largest == S::zero() {
        return largest;
    }
    let (a, b) = (a / largest, b / largest);
    largest * a.mul_add(a, b * b).sqrt()
}

/// Takes the rows of H U (k x N, one per measurement) through all updates. `spreads` and `d` are updated, and
/// `changes` (2k x N) receives the two numbers of each update and column, one after the other. Column i of `gains` (k
/// x k) becomes the gain of update i times its spread, multiplied by the later rows of H; its entries on and above
/// the diagonal are meaningless.
#[inline(always)]
fn recursion<S: Scalar, P: ColumnPass<S>>(
    mut rows: ViewMut<'_, S>,
    spreads: &mut [S],
    d: &mut [S],
    mut changes: ViewMut<'_, S>,
    mut gains: ViewMut<'_, S>,
) {
    gains.fill(S::zero());
    let count = rows.rows();
    let mut first = 0;
    while first < count {
        let taken = (count - first).min(4);
        let (rows, gains) = (rows.reborrow(), gains.reborrow());
        match taken {
            1 => few_rows::<S, P, 1>(first, rows, spreads, d, changes.reborrow(), gains),
            2 => few_rows::<S, P, 2>(first, rows, spreads, d, changes.reborrow(), gains),
            3 => few_rows::<S, P, 3>(first, rows, spreads, d, changes.reborrow(), gains),
            _ => few_rows::<S, P, 4>(first, rows, spreads, d, changes.reborrow(), gains),
        }
        first += taken;
    }
}

/// Performs updates first .. first + K with their numbers in registers, and applies them to the later rows.
#[inline(always)]
fn few_rows<S: Scalar, P: ColumnPass<S>, const K: usize>(
    first: usize,
    mut rows: ViewMut<'_, S>,
    spreads: &mut [S],
    d: &mut [S],
    mut changes: ViewMut<'_, S>,
    mut gains: ViewMut<'_, S>,
) {
    let end = first + K;
    let mut spread: [S; K] = std::array::from_fn(|k| spreads[first + k]);
    let mut gain = [[Pack::<S, 1>::zero(); K]; K];
    for j in 0..rows.columns() {
        let (row, changes) = (rows.column_mut(j), changes.column_mut(j));
        let mut own: [Pack<S, 1>; K] = std::array::from_fn(|k| Pack([row[first + k]]));
        let (mut weight, mut by) = (d[j], [[S::zero(); 2]; K]);
        for i in 0..K {
            by[i] = P::enter(own[i].0[0], &mut spread[i], &mut weight);
            for l in i + 1..K {
                (own[l], gain[l][i]) = P::apply(by[i], own[l], gain[l][i]);
            }
        }
        d[j] = weight;
        changes[2 * first..2 * end].copy_from_slice(by.as_flattened());
        for (l, x) in row.iter_mut().enumerate().skip(end) {
            for i in 0..K {
                let gain = gains.at_mut(l, first + i);
                let (u, next) = P::apply(by[i], Pack([*x]), Pack([*gain]));
                (*x, *gain) = (u.0[0], next.0[0]);
            }
        }
    }
    for i in 0..K {
        spreads[first + i] = spread[i];
        for l in i + 1..K {
            *gains.at_mut(first + l, first + i) = gain[l][i].0[0];
        }
    }
}

/// Takes the rows of a panel through all updates. The columns of `changes` are those of the panel; `gains` (a panel's
/// rows x k) is overwritten with the gains times their spreads.
#[inline(always)]
fn sweep<S: Scalar, P: ColumnPass<S>>(mut panel: ViewMut<'_, S>, changes: View<'_, S>, mut gains: ViewMut<'_, S>) {
    let (rows, count) = (panel.rows(), gains.columns());
    let mut first = 0;
    while first < count {
        let taken = (count - first).min(4);
        let mut at = 0;
        while at < rows {
            let (panel, gains) = (panel.reborrow(), gains.block_mut(0, first, rows, taken));
            at += match rows - at {
                32.. => rows_sweep::<S, P, 32>(panel, changes, first, at, gains),
                16.. => rows_sweep::<S, P, 16>(panel, changes, first, at, gains),
                8.. => rows_sweep::<S, P, 8>(panel, changes, first, at, gains),
                _ => rows_sweep::<S, P, 1>(panel, changes, first, at, gains),
            };
        }
        first += taken;
    }
}

/// Takes rows at .. at + W through the updates from `first` on, one for each column of `gains`. Returns W.
#[inline(always)]
fn rows_sweep<S: Scalar, P: ColumnPass<S>, const W: usize>(
    panel: ViewMut<'_, S>,
    changes: View<'_, S>,
    first: usize,
    at: usize,
    gains: ViewMut<'_, S>,
) -> usize {
    match gains.columns() {
        1 => updates_sweep::<S, P, W, 1>(panel, changes, first, at, gains),
        2 => updates_sweep::<S, P, W, 2>(panel, changes, first, at, gains),
        3 => updates_sweep::<S, P, W, 3>(panel, changes, first, at, gains),
        _ => updates_sweep::<S, P, W, 4>(panel, changes, first, at, gains),
    }
    W
}

#[inline(always)]
fn updates_sweep<S: Scalar, P: ColumnPass<S>, const W: usize, const K: usize>(
    mut panel: ViewMut<'_, S>,
    changes: View<'_, S>,
    first: usize,
    at: usize,
    mut gains: ViewMut<'_, S>,
) {
    let mut gathered = [Pack::<S, W>::zero(); K];
    // These rows are zero before column `at`.
    for j in at..panel.columns() {
        let by = &changes.column(j)[2 * first..2 * (first + K)];
        let column = &mut panel.column_mut(j)[at..at + W];
        let mut u = Pack::<S, W>::load(column);
        for k in 0..K {
            (u, gathered[k]) = P::apply([by[2 * k], by[2 * k + 1]], u, gathered[k]);
        }
        u.store(column);
    }
    for k in 0..K {
        gathered[k].store(&mut gains.column_mut(k)[at..]);
    }
}

#[inline(always)]
pub fn bierman_recursion<S: Scalar>(
    rows: ViewMut<'_, S>,
    spreads: &mut [S],
    d: &mut [S],
    changes: ViewMut<'_, S>,
    gains: ViewMut<'_, S>,
) {
    recursion::<S, Bierman>(rows, spreads, d, changes, gains);
}

#[inline(always)]
pub fn bierman_sweep<S: Scalar>(panel: ViewMut<'_, S>, changes: View<'_, S>, gains: ViewMut<'_, S>) {
    sweep::<S, Bierman>(panel, changes, gains);
}

#[inline(always)]
pub fn givens_recursion<S: Scalar>(
    rows: ViewMut<'_, S>,
    spreads: &mut [S],
    d: &mut [S],
    changes: ViewMut<'_, S>,
    gains: ViewMut<'_, S>,
) {
    recursion::<S, Givens>(rows, spreads, d, changes, gains);
}

#[inline(always)]
pub fn givens_sweep<S: Scalar>(panel: ViewMut<'_, S>, changes: View<'_, S>, gains: ViewMut<'_, S>) {
    sweep::<S, Givens>(panel, changes, gains);
}
