//! Panel storage of an upper triangular matrix for the factored forms, and its product with a transition.

use super::Pack;
use crate::{Scalar, View, ViewMut};

/// The layout of an upper triangular matrix of (count n) x (count n) in one matrix of half the size.
///
/// Panel k is rows kn .. (k + 1)n without the columns before kn, which are zero. The panels are stored side by side,
/// each padded with rows of zeros to a whole number of packs. Therefore no kernel has a ragged end, and each panel is
/// a separate block of columns, which another thread may process. The zeros below the diagonal of a panel's first n
/// columns are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PanelLayout {
    n: usize,
    count: usize,
}

impl PanelLayout {
    /// The number of rows is padded to a multiple of this.
    pub const ROWS: usize = 8;

    /// Creates the layout for `count` panels of n rows.
    pub fn new(n: usize, count: usize) -> Self {
        Self { n, count }
    }

    /// Returns the number of rows of a panel without padding, n.
    pub fn n(&self) -> usize {
        self.n
    }

    /// Returns the number of panels.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Returns the number of rows and of columns of the triangular matrix.
    pub fn size(&self) -> usize {
        self.n * self.count
    }

    /// Returns the number of rows of the matrix that holds the panels.
    pub fn rows(&self) -> usize {
        self.n.next_multiple_of(Self::ROWS)
    }

    /// Returns the column of that matrix with which panel k begins; for k = `count`, its number of columns.
    pub fn start(&self, k: usize) -> usize {
        // The sum of (count - i) n over the preceding panels i.
        self.n * (k * self.count - k * k.saturating_sub(1) / 2)
    }

    /// Returns the position of column j of panel k, where j counts from the first column of the triangular matrix and
    /// is at least kn.
    pub fn column(&self, k: usize, j: usize) -> usize {
        self.start(k) + j - k * self.n
    }

    /// Returns the first panel of the second half, chosen so that both halves have about as many entries.
    pub fn half(&self) -> usize {
        let total = self.start(self.count);
        let off = |k: usize| (2 * self.start(k)).abs_diff(total);
        (0..=self.count).min_by_key(|&k| off(k)).unwrap_or(0)
    }
}

/// Advances the columns x of the first panel, from column `first` on:
/// [Ux, Uxt] <- [Abar Ux, Abar Uxt + (phi (x) I) Ut]. `theta` holds the panels from the second one on.
///
/// J is given as a sum of shifts: column i of `shifts` (a panel's rows x s) has a one in each row in which J has its
/// one `offsets[i]` columns before the diagonal. `outputs` are the rows c_k, `abar` (a panel's rows x p) holds the
/// abar_k, and `work` has p entries.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
pub fn advance_panel<S: Scalar>(
    layout: PanelLayout,
    theta: View<'_, S>,
    phi: &[S],
    offsets: &[usize],
    shifts: View<'_, S>,
    outputs: &[usize],
    abar: View<'_, S>,
    first: usize,
    mut x: ViewMut<'_, S>,
    work: &mut [S],
) {
    // Columns and rows are processed from the last to the first, because J takes each row from a row above it.
    let (rows, stride) = (x.rows(), x.stride());
    for c in (0..x.columns()).rev() {
        let j = first + c;
        // Only the first j / n of the panels in `theta` reach this column.
        let column = Column { layout, theta, phi: &phi[..phi.len().min(j / layout.n)], offsets, shifts, abar, j };
        let begin = c * stride;
        let x = x.data_mut();
        for (seen, &row) in work.iter_mut().zip(outputs) {
            *seen = x[begin + row];
        }
        let mut end = rows;
        while end > 0 {
            end -= match end % 32 {
                0 => column.advance::<32>(end, begin, x, work),
                16 => column.advance::<16>(end, begin, x, work),
                _ => column.advance::<8>(end, begin, x, work),
            };
        }
    }
}

/// The data that are needed to advance one column.
struct Column<'a, S> {
    layout: PanelLayout,
    theta: View<'a, S>,
    phi: &'a [S],
    offsets: &'a [usize],
    shifts: View<'a, S>,
    abar: View<'a, S>,
    j: usize,
}

impl<S: Scalar> Column<'_, S> {
    /// Advances rows `end` - W .. `end` of the column that begins at `x[begin]`. Returns W.
    #[inline(always)]
    fn advance<const W: usize>(&self, end: usize, begin: usize, x: &mut [S], seen: &[S]) -> usize {
        let at = end - W;
        let mut sum = Pack::<S, W>::zero();
        for (i, &offset) in self.offsets.iter().enumerate() {
            // The entries before the column belong to the end of the previous one; the zeros of J remove them.
            let place = begin + at;
            let from = if place >= offset { Pack::load(&x[place - offset..]) } else { first_rows(x, offset - place) };
            sum = sum.add_product(from, Pack::load(&self.shifts.column(i)[at..]));
        }
        for k in 0..self.abar.columns() {
            sum = sum.add_scaled(Pack::load(&self.abar.column(k)[at..]), seen[k]);
        }
        if !self.phi.is_empty() {
            // `place` begins in panel 1, whose first column is column n. Each panel has n columns fewer than the one
            // before.
            let (n, mut place) = (self.layout.n, self.j - self.layout.n);
            let mut step = (self.layout.count - 1) * n;
            for &weight in self.phi {
                sum = sum.add_scaled(Pack::load(&self.theta.column(place)[at..]), weight);
                step -= n;
                place += step;
            }
        }
        sum.store(&mut x[begin + at..]);
        W
    }
}

/// Returns `zeros` zeros, followed by entries of x.
#[inline(always)]
fn first_rows<S: Scalar, const W: usize>(x: &[S], zeros: usize) -> Pack<S, W> {
    let mut pack = Pack::zero();
    let zeros = zeros.min(W);
    pack.0[zeros..].copy_from_slice(&x[..W - zeros]);
    pack
}
