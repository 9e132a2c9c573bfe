//! The interface to a matrix library: storage and a few coarse in-place kernels.
//!
//! Every kernel has a plain body over column slices, in [`kernels`]. A backend overrides the kernels that its library
//! does better, so a new backend at first needs only its storage.

use std::fmt::Debug;

use crate::kernels::{Kernels, Support, Tails};
use crate::{Matrix, View, ViewMut};

/// Storage and kernels. No method allocates.
pub trait Backend: Clone + Copy + Debug + Send + Sync + 'static {
    /// The number type.
    type Scalar: Kernels;

    /// The matrix that holds P in one of its forms.
    type Matrix: Matrix<Self::Scalar>;

    /// Calls both functions, in parallel if the backend has two threads. The order of all sums is the same either
    /// way.
    fn join<A: Send, B: Send>(a: impl FnOnce() -> A + Send, b: impl FnOnce() -> B + Send) -> (A, B) {
        (a(), b())
    }

    /// Computes C <- C + alpha A B^T for a product that is symmetric. A and B are N x k. The lower triangle of C (N x
    /// N) is changed; the strict upper triangle is not.
    fn symmetric_product_lower(
        c: ViewMut<'_, Self::Scalar>,
        alpha: Self::Scalar,
        a: View<'_, Self::Scalar>,
        b: View<'_, Self::Scalar>,
    ) {
        let size = c.columns();
        // The columns before `half` contain half of the triangle.
        let half = size - (size as f64 * f64::sqrt(0.5)) as usize;
        let (first, mut second) = c.split_at_column(half);
        let second = second.block_mut(half, 0, size - half, size - half);
        let rest = (a.block(half, 0, size - half, a.columns()), b.block(half, 0, size - half, b.columns()));
        Self::join(
            || Self::Scalar::symmetric_product_lower(first, alpha, a, b),
            || Self::Scalar::symmetric_product_lower(second, alpha, rest.0, rest.1),
        );
    }

    /// Computes Y <- Y + M (phi (x) I)^T for a symmetric M whose lower triangle is stored, with zeros above it. M is
    /// kn x kn, phi has k entries, and Y is kn x n. `work` is n x kc, for c columns of Y at a time.
    fn block_product_lower(
        m: View<'_, Self::Scalar>,
        phi: &[Self::Scalar],
        mut y: ViewMut<'_, Self::Scalar>,
        mut work: ViewMut<'_, Self::Scalar>,
    ) {
        let (n, k) = (y.columns(), phi.len());
        let at_once = work.columns() / k;
        for from in (0..n).step_by(at_once) {
            let count = at_once.min(n - from);
            let half = count / 2;
            let mut columns = y.block_mut(0, from, m.rows(), count);
            let (first, second) = columns.reborrow().split_at_column(half);
            let mut work = work.block_mut(0, 0, n, k * count);
            let (first_work, second_work) = work.reborrow().split_at_column(half * k);
            Self::join(
                || Self::Scalar::block_product_lower(m, phi, from, first, first_work),
                || Self::Scalar::block_product_lower(m, phi, from + half, second, second_work),
            );
            let (first, second) = y.reborrow().split_at_column(n / 2);
            Self::join(
                || Self::Scalar::add_mirrored(work.view(), k, from, 0, first),
                || Self::Scalar::add_mirrored(work.view(), k, from, n / 2, second),
            );
        }
    }

    /// Computes the unit upper triangular U and the d with U diag(d) U^T = W diag(weights) W^T by modified weighted
    /// Gram-Schmidt orthogonalisation (Thornton; Bierman 1977, ch. VI) of the first n rows of W (n x r). If W has
    /// further rows, those of U are zero. `w` is destroyed; `work` has 4r + rows(W) entries.
    fn weighted_gram_schmidt(
        w: ViewMut<'_, Self::Scalar>,
        support: Support<'_>,
        weights: &[Self::Scalar],
        u: ViewMut<'_, Self::Scalar>,
        d: &mut [Self::Scalar],
        work: &mut [Self::Scalar],
    ) {
        Self::Scalar::weighted_gram_schmidt(w, support, weights, u, d, work);
    }

    /// Computes the upper triangular S (n x n) with S S^T = W W^T by Householder reflections of the columns of W (n x
    /// r, r >= n). If W has further rows, those of S are zero. `w` is destroyed; `work` has 2r + rows(W) entries.
    fn triangular_factor(
        w: ViewMut<'_, Self::Scalar>,
        n: usize,
        tails: Tails<'_>,
        s: ViewMut<'_, Self::Scalar>,
        work: &mut [Self::Scalar],
    ) {
        Self::Scalar::triangular_factor(w, n, tails, s, work);
    }
}
