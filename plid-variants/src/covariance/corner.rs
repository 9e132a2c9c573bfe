//! The time update of a factor's first n columns: a new triangular factor of Abar Ux D Ux^T Abar^T + Qbar.

use plid_core::kernels::{BadPivot, Kernels, PanelLayout, Support, Tails, pivoted_cholesky};
use plid_core::{Backend, Dense, ImplicitModel, Matrix, Transition, View, ViewMut};

/// Abar of a transition in the layout of the kernels.
#[derive(Clone, Debug)]
pub struct Advance<S> {
    layout: PanelLayout,
    /// The c_k.
    outputs: Vec<usize>,
    /// The distances before the diagonal at which J has ones. `shifts` marks the rows of these ones (the rows of a
    /// panel, one column per distance).
    offsets: Vec<usize>,
    shifts: Dense<S>,
    /// The columns abar_k (rows of a panel x p).
    abar: Dense<S>,
}

impl<S: Kernels> Advance<S> {
    /// Takes J and the c_k from `model`.
    pub fn new(model: &dyn ImplicitModel, layout: PanelLayout) -> Self {
        let offset = |i: usize| model.shift_source(i).map(|from| i - from);
        let mut offsets: Vec<usize> = (0..layout.n()).filter_map(offset).collect();
        offsets.sort_unstable();
        offsets.dedup();
        let one_where = |is: bool| if is { S::one() } else { S::zero() };
        let shifts = Dense::from_fn(layout.rows(), offsets.len(), |i, k| {
            one_where(i < layout.n() && offset(i) == Some(offsets[k]))
        });
        let abar = Dense::zeros(layout.rows(), model.outputs());
        Self { layout, outputs: model.output_states().to_vec(), offsets, shifts, abar }
    }

    /// Takes the columns of Abar.
    pub fn set(&mut self, transition: &Transition<S>) {
        for k in 0..self.outputs.len() {
            self.abar.column_mut(k)[..self.layout.n()].copy_from_slice(transition.abar.column(k));
        }
    }

    /// Computes X <- Abar X + (phi (x) I) Ut for the columns of the first panel, from `first` on.
    pub fn apply(&self, theta: View<'_, S>, phi: &[S], first: usize, x: ViewMut<'_, S>, work: &mut [S]) {
        let (shifts, abar) = (self.shifts.view(), self.abar.view());
        S::advance_panel(self.layout, theta, phi, &self.offsets, shifts, &self.outputs, abar, first, x, work);
    }

    /// Returns, for each row of Abar Ux, the column before which this row and all rows below it are zero.
    fn first_columns(&self) -> Vec<usize> {
        let n = self.layout.n();
        // Row i of Ux begins on the diagonal. Row i of Abar Ux combines the row that J selects with the rows of the
        // outputs.
        let first_output = self.outputs.iter().copied().min().unwrap_or(n);
        let taken = |i: usize| (0..self.offsets.len()).find(|&k| self.shifts.at(i, k) != S::zero());
        let mut starts: Vec<usize> =
            (0..n).map(|i| taken(i).map_or(n, |k| i - self.offsets[k]).min(first_output)).collect();
        for i in (0..n.saturating_sub(1)).rev() {
            starts[i] = starts[i].min(starts[i + 1]);
        }
        starts
    }
}

/// The array W = [Abar Ux, L] with weights, and the scratch for its triangularisation.
#[derive(Clone, Debug)]
pub struct Corner<S> {
    n: usize,
    /// Number of rows of a panel.
    rows: usize,
    /// Storage for W.
    array: Vec<S>,
    /// The weights of its columns.
    weights: Vec<S>,
    /// The columns at which the rows begin if L is triangular.
    triangular: Vec<[usize; 2]>,
    /// The columns at which they begin if L is not triangular.
    general: Vec<[usize; 2]>,
    starts: Vec<usize>,
    zeros: Vec<usize>,
    ends: Vec<usize>,
    work: Vec<S>,
    outputs: Vec<S>,
    qbar: Dense<S>,
    root: Dense<S>,
}

/// Unused numbers between the columns of W. Without them, the entries of a row would share a few cache lines. At most
/// as many numbers are left unused at the beginning.
const GAP: usize = PanelLayout::ROWS;

/// Returns W in its storage, with `columns` columns of `rows` rows. It begins at a cache line, because the kernels
/// load and store whole cache lines.
fn array<S: Kernels>(room: &mut [S], rows: usize, columns: usize) -> ViewMut<'_, S> {
    let offset = room.as_ptr().align_offset(GAP * size_of::<S>()).min(GAP);
    ViewMut::new(&mut room[offset..], rows, columns, rows + GAP)
}

/// The shape of L.
#[derive(Clone, Copy, Debug)]
pub struct Laid {
    /// The columns of the array that are in use.
    columns: usize,
    /// Whether L is upper triangular.
    triangular: bool,
}

impl<S: Kernels> Corner<S> {
    /// Allocates the array.
    pub fn new(advance: &Advance<S>) -> Self {
        let (n, rows, starts) = (advance.layout.n(), advance.layout.rows(), advance.first_columns());
        Self {
            n,
            rows,
            array: vec![S::zero(); 2 * n * (rows + GAP) + GAP],
            weights: vec![S::one(); 2 * n],
            triangular: starts.iter().enumerate().map(|(i, &start)| [start, n + i]).collect(),
            general: starts.iter().map(|&start| [start, n]).collect(),
            starts,
            zeros: vec![0; n],
            ends: vec![n; n],
            work: vec![S::zero(); 8 * n + rows],
            outputs: vec![S::zero(); advance.outputs.len()],
            qbar: Dense::zeros(n, n),
            root: Dense::zeros(n, n),
        }
    }

    /// Fills the array with [Abar Ux, L], and sets the weights of the columns of L.
    ///
    /// # Errors
    /// Returns a pivot of Qbar that is not finite.
    pub fn lay(&mut self, advance: &Advance<S>, ux: View<'_, S>, qbar: &Dense<S>) -> Result<Laid, BadPivot> {
        let n = self.n;
        let (mut left, mut right) = array(&mut self.array, self.rows, 2 * n).split_at_column(n);
        for c in 0..n {
            left.column_mut(c).copy_from_slice(ux.column(c));
        }
        advance.apply(ux, &[], 0, left, &mut self.outputs);
        // Qbar is a second moment. If it is clearly positive definite, its factor may be triangular, which keeps the
        // rows of the array short.
        let tolerance = 64.0 * n as f64 * S::EPSILON;
        S::upper_ldl(qbar.view(), right.reborrow(), &mut self.weights[n..], S::from_f64(tolerance), &mut self.work);
        let lost = |i: usize| self.weights[n + i] == S::zero() && qbar.at(i, i) != S::zero();
        if !(0..n).any(lost) {
            return Ok(Laid { columns: 2 * n, triangular: true });
        }
        // If w determines v and xi completely, only a rounding error of either sign remains of a pivot. The
        // factorisation then needs pivoting.
        for c in 0..n {
            self.qbar.column_mut(c).copy_from_slice(qbar.column(c));
        }
        let (copy, root) = (self.qbar.view_mut(), self.root.view_mut());
        let rank = pivoted_cholesky(copy, root, &mut self.work, tolerance, f64::INFINITY)?;
        for c in 0..rank {
            let column = right.column_mut(c);
            column[..n].copy_from_slice(self.root.column(c));
            column[n..].fill(S::zero());
        }
        self.weights[n..].fill(S::one());
        Ok(Laid { columns: n + rank, triangular: false })
    }

    /// Computes U' and d' by weighted Gram-Schmidt. On entry, `d` holds the n entries that belong to Ux.
    pub fn gram_schmidt<B: Backend<Scalar = S>>(&mut self, laid: Laid, u: ViewMut<'_, S>, d: &mut [S]) {
        let n = self.n;
        self.weights[..n].copy_from_slice(d);
        let starts = if laid.triangular { &self.triangular } else { &self.general };
        B::weighted_gram_schmidt(
            array(&mut self.array, self.rows, laid.columns),
            Support { starts, middle: n },
            &self.weights[..laid.columns],
            u,
            d,
            &mut self.work,
        );
    }

    /// Computes S' by reflections.
    pub fn reflect<B: Backend<Scalar = S>>(&mut self, laid: Laid, s: ViewMut<'_, S>) {
        let n = self.n;
        if laid.triangular {
            let mut array = array(&mut self.array, self.rows, 2 * n);
            for c in 0..n {
                let root = self.weights[n + c].sqrt();
                array.column_mut(n + c)[..=c].iter_mut().for_each(|x| *x *= root);
            }
            // Each row is reflected into its own column of L, in which all rows below it are zero.
            self.ends.fill(n);
        } else {
            for (i, end) in self.ends.iter_mut().enumerate() {
                *end = laid.columns - n + i;
            }
        }
        let starts = if laid.triangular { &self.starts } else { &self.zeros };
        let tails = Tails { starts, ends: &self.ends };
        B::triangular_factor(array(&mut self.array, self.rows, laid.columns), n, tails, s, &mut self.work);
    }
}
