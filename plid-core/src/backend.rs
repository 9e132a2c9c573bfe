//! A matrix library under the recursion: storage, and a few coarse in-place kernels.
//!
//! Every kernel has a plain body over column slices, in [`kernels`]. A backend overrides those that its library does better; a
//! new backend is its storage and, at first, nothing else.

use std::fmt::Debug;

use crate::{Matrix, Scalar, View, ViewMut, kernels};

/// Storage and kernels. Nothing here allocates.
pub trait Backend: Clone + Copy + Debug + Send + Sync + 'static {
    /// The number type.
    type Scalar: Scalar;

    /// The matrix that holds P in one of its forms.
    type Matrix: Matrix<Self::Scalar>;

    /// C <- C + alpha A B^T for a product that is symmetric. A and B are N x k. The lower triangle of C (N x N) is
    /// meant; the strict upper one may hold anything afterwards.
    fn symmetric_product_lower(
        c: ViewMut<'_, Self::Scalar>,
        alpha: Self::Scalar,
        a: View<'_, Self::Scalar>,
        b: View<'_, Self::Scalar>,
    ) {
        kernels::symmetric_product_lower(c, alpha, a, b);
    }

    /// Y <- Y + M (phi (x) I)^T for a symmetric M of which the lower triangle is stored. M is kn x kn, phi has k
    /// entries, Y is kn x n; `work` holds n entries.
    fn block_product_lower(
        m: View<'_, Self::Scalar>,
        phi: &[Self::Scalar],
        y: ViewMut<'_, Self::Scalar>,
        work: &mut [Self::Scalar],
    ) {
        kernels::block_product_lower(m, phi, y, work);
    }

    /// Modified weighted Gram-Schmidt (Thornton; Bierman 1977, ch. VI): given the array W (n x r) as its transpose
    /// `wt` (r x n), and the weights of W's columns, finds U unit upper triangular and d with
    /// U diag(d) U^T = W diag(weights) W^T. `wt` is destroyed; `u` is n x n and is overwritten.
    fn weighted_gram_schmidt(
        wt: ViewMut<'_, Self::Scalar>,
        weights: &[Self::Scalar],
        u: ViewMut<'_, Self::Scalar>,
        d: &mut [Self::Scalar],
        work: &mut [Self::Scalar],
    ) {
        kernels::weighted_gram_schmidt(wt, weights, u, d, work);
    }

    /// The upper triangular S (n x n) with S S^T = W W^T, by Householder reflections of the transposed array `wt`
    /// (r x n, r >= n), whose columns are taken from the last to the first. `wt` is destroyed.
    fn triangular_factor(wt: ViewMut<'_, Self::Scalar>, s: ViewMut<'_, Self::Scalar>, work: &mut [Self::Scalar]) {
        kernels::triangular_factor(wt, s, work);
    }
}
