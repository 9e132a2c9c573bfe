//! An upper triangular matrix in panels: the storage of the factored forms, and its product with a transition.

use super::Pack;
use crate::{Scalar, View, ViewMut};

/// The layout of an upper triangular matrix of (count n) x (count n) in one matrix of half the size.
///
/// Panel k is rows kn .. (k + 1)n, of which the columns before kn are zero and are not kept. The panels stand side by
/// side, each filled up with rows of zeros to a whole number of packs: no kernel has a ragged end, and each panel is a
/// block of columns of its own, which another thread may have. Zeros below the diagonal of a panel's first n columns
/// are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PanelLayout {
    n: usize,
    count: usize,
}

impl PanelLayout {
    /// Rows are filled up to a multiple of this.
    pub const ROWS: usize = 8;

    /// The layout for `count` panels of n rows.
    pub fn new(n: usize, count: usize) -> Self {
        Self { n, count }
    }

    /// Rows of a panel that mean something, n.
    pub fn n(&self) -> usize {
        self.n
    }

    /// The number of panels.
    pub fn count(&self) -> usize {
        self.count
    }

    /// The number of rows and of columns of the triangular matrix.
    pub fn size(&self) -> usize {
        self.n * self.count
    }

    /// Rows of the matrix that holds the panels.
    pub fn rows(&self) -> usize {
        self.n.next_multiple_of(Self::ROWS)
    }

    /// The column of that matrix with which panel k begins; for k = `count`, its number of columns.
    pub fn start(&self, k: usize) -> usize {
        // The sum of (count - i) n over the panels i before.
        self.n * (k * self.count - k * k.saturating_sub(1) / 2)
    }

    /// The position of column j of panel k; j counts from the first column of the triangular matrix, and is at least
    /// kn.
    pub fn column(&self, k: usize, j: usize) -> usize {
        self.start(k) + j - k * self.n
    }

    /// The first panel of the second half, where both halves have about as many entries.
    pub fn half(&self) -> usize {
        let total = self.start(self.count);
        let off = |k: usize| (2 * self.start(k)).abs_diff(total);
        (0..=self.count).min_by_key(|&k| off(k)).unwrap_or(0)
    }
}

/// To columns of the first panel from column `first` on, x, [Ux, Uxt] <- [Abar Ux, Abar Uxt + (phi (x) I) Ut]: `theta`
/// holds the panels from the second one on.
///
/// J is given as a sum of shifts: column i of `shifts` (a panel's rows x s) has a one in the rows in which the one of J
/// stands `offsets[i]` before the diagonal. `outputs` are the rows c_k, `abar` (a panel's rows x p) holds the abar_k,
/// `work` p entries.
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
    // From the last column and row on, since J takes a row from one above it.
    let (rows, stride) = (x.rows(), x.stride());
    for c in (0..x.columns()).rev() {
        let j = first + c;
        // Panels 1 .. blocks reach into this column.
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

/// The contribution to one column.
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
    /// Rows `end` - W .. `end` of the column that begins at `x[begin]`. Returns W.
    #[inline(always)]
    fn advance<const W: usize>(&self, end: usize, begin: usize, x: &mut [S], seen: &[S]) -> usize {
        let at = end - W;
        let mut sum = Pack::<S, W>::zero();
        for (i, &offset) in self.offsets.iter().enumerate() {
            // Above the column is the end of the one before, which the zeros of J remove.
            let place = begin + at;
            let from = if place >= offset { Pack::load(&x[place - offset..]) } else { first_rows(x, offset - place) };
            sum = sum.add_product(from, Pack::load(&self.shifts.column(i)[at..]));
        }
        for k in 0..self.abar.columns() {
            sum = sum.add_scaled(Pack::load(&self.abar.column(k)[at..]), seen[k]);
        }
        if !self.phi.is_empty() {
            // In panel 1, of which column n is the first; then a panel on, each with n columns fewer.
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

/// So many zeros, then entries of x.
#[inline(always)]
fn first_rows<S: Scalar, const W: usize>(x: &[S], zeros: usize) -> Pack<S, W> {
    let mut pack = Pack::zero();
    let zeros = zeros.min(W);
    pack.0[zeros..].copy_from_slice(&x[..W - zeros]);
    pack
}
