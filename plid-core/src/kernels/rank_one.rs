//! Rank-one updates of a covariance in triangular form. The columns are processed from the last to the first.

use super::measurement::{ColumnPass, Givens};
use super::{Pack, PanelLayout};
use crate::{Scalar, ViewMut};

/// Updates U diag(d) U^T by c a a^T with the method of Agee and Turner.
#[inline(always)]
pub fn agee_turner<S: Scalar>(
    layout: PanelLayout,
    mut u: ViewMut<'_, S>,
    d: &mut [S],
    mut a: ViewMut<'_, S>,
    place: usize,
    mut c: S,
) {
    for j in (0..=place).rev() {
        let (block, row) = (j / layout.n(), j % layout.n());
        let head = a.at(row, block);
        let sum = d[j] + c * head * head;
        if sum != S::zero() {
            let factor = c * head / sum;
            each_pack(layout, j, u.reborrow(), a.reborrow(), |u, a| {
                let a = a.add_scaled(u, -head);
                (u.add_scaled(a, factor), a)
            });
            c *= d[j] / sum;
            d[j] = sum;
        }
        *a.at_mut(row, block) = S::zero();
    }
}

/// Rotates a into S.
#[inline(always)]
pub fn rotate_in<S: Scalar>(layout: PanelLayout, mut s: ViewMut<'_, S>, mut a: ViewMut<'_, S>, place: usize) {
    for j in (0..=place).rev() {
        let (block, row) = (j / layout.n(), j % layout.n());
        let (pivot, head) = (s.at(row, layout.column(block, j)), a.at(row, block));
        let mut length = pivot;
        let by = Givens::enter(head, &mut length, &mut S::zero());
        // The column takes the place of the gain in the rotation.
        each_pack(layout, j, s.reborrow(), a.reborrow(), |s, a| {
            let (a, s) = Givens::apply(by, a, s);
            (s, a)
        });
        *a.at_mut(row, block) = S::zero();
    }
}

/// Applies `f` to all rows of column j of the matrix and of the vector.
#[inline(always)]
fn each_pack<S: Scalar>(
    layout: PanelLayout,
    j: usize,
    mut matrix: ViewMut<'_, S>,
    mut vector: ViewMut<'_, S>,
    f: impl Fn(Pack<S, 8>, Pack<S, 8>) -> (Pack<S, 8>, Pack<S, 8>),
) {
    for k in 0..=j / layout.n() {
        let (column, entries) = (matrix.column_mut(layout.column(k, j)), vector.column_mut(k));
        for (column, entries) in column.chunks_exact_mut(8).zip(entries.chunks_exact_mut(8)) {
            let (x, y) = f(Pack::load(column), Pack::load(entries));
            x.store(column);
            y.store(entries);
        }
    }
}
