//! Columns of U diag(d) U^T: the covariances of all states with a few of them.

use super::{Pack, PanelLayout};
use crate::{Scalar, View, ViewMut};

/// The number of columns of U whose weights are formed at a time.
const SPAN: usize = 64;

#[inline(always)]
pub fn output_columns<S: Scalar>(
    layout: PanelLayout,
    u: View<'_, S>,
    d: &[S],
    rows: &[usize],
    mut out: ViewMut<'_, S>,
) {
    out.fill(S::zero());
    let mut first = 0;
    while first < rows.len() {
        let taken = (rows.len() - first).min(4);
        let (rows, out) = (&rows[first..first + taken], out.block_mut(0, first, layout.size(), taken));
        match taken {
            1 => few_columns::<S, 1>(layout, u, d, rows, out),
            2 => few_columns::<S, 2>(layout, u, d, rows, out),
            3 => few_columns::<S, 3>(layout, u, d, rows, out),
            _ => few_columns::<S, 4>(layout, u, d, rows, out),
        }
        first += taken;
    }
}

#[inline(always)]
fn few_columns<S: Scalar, const K: usize>(
    layout: PanelLayout,
    u: View<'_, S>,
    d: &[S],
    rows: &[usize],
    mut out: ViewMut<'_, S>,
) {
    let n = layout.n();
    for from in (0..layout.size()).step_by(SPAN) {
        let to = layout.size().min(from + SPAN);
        let mut weights = [[S::zero(); K]; SPAN];
        for j in from..to {
            // The outputs' rows are in the first panel, which begins with column 0.
            weights[j - from] = std::array::from_fn(|k| d[j] * u.at(rows[k], j));
        }
        for panel in 0..=(to - 1) / n {
            let mut at = 0;
            while at < n {
                let place = Place { layout, panel, at, from, to };
                at += match n.next_multiple_of(PanelLayout::ROWS) - at {
                    32.. => place.add::<S, 32, K>(u, &weights, out.reborrow()),
                    16.. => place.add::<S, 16, K>(u, &weights, out.reborrow()),
                    _ => place.add::<S, 8, K>(u, &weights, out.reborrow()),
                };
            }
        }
    }
}

/// The rows of a panel from `at` on, and the columns from .. to.
struct Place {
    layout: PanelLayout,
    panel: usize,
    at: usize,
    from: usize,
    to: usize,
}

impl Place {
    /// Adds the contribution of these columns to W rows of the result. Returns W.
    #[inline(always)]
    fn add<S: Scalar, const W: usize, const K: usize>(
        &self,
        u: View<'_, S>,
        weights: &[[S; K]; SPAN],
        mut out: ViewMut<'_, S>,
    ) -> usize {
        let n = self.layout.n();
        // The result has no rows of padding.
        let (row, kept) = (self.panel * n + self.at, W.min(n - self.at));
        let mut sums = [Pack::<S, W>::zero(); K];
        for k in 0..K {
            sums[k].0[..kept].copy_from_slice(&out.column(k)[row..row + kept]);
        }
        for j in self.from.max(row)..self.to {
            let entries = Pack::<S, W>::load(&u.column(self.layout.column(self.panel, j))[self.at..]);
            for k in 0..K {
                sums[k] = sums[k].add_scaled(entries, weights[j - self.from][k]);
            }
        }
        for k in 0..K {
            out.column_mut(k)[row..row + kept].copy_from_slice(&sums[k].0[..kept]);
        }
        W
    }
}
