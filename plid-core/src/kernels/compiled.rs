//! The kernels that a step spends its time in, as methods of the scalar.
//!
//! Their bodies are generic and are in the other files of this folder. `f32` and `f64` have them compiled here and
//! nowhere else, once for each of several instruction sets (`multiversion`), of which the best that the CPU has is
//! chosen at run time: a plain build is already fast, and a crate that uses them does not compile them again. Fused
//! multiply-adds, and sums whose order does not depend on the width of the registers, give the same bits on all of
//! them.

use crate::{Scalar, View, ViewMut};

use super::gram_schmidt::Support;
use super::householder::Tails;
use super::panels::PanelLayout;
use super::{
    Shift, gram_schmidt, householder, measurement, output_columns, panels, parameter_blocks, rank_one, symmetric,
};

/// Hands the list of all kernels, for the scalar `$s`, to the macro `$make`. A new kernel is one entry here and its
/// body.
macro_rules! each_kernel {
    ($make:ident, $s:ty) => {
        $make! {
            $s;
            /// C <- C + alpha A B^T for a product that is symmetric; only the lower triangle of C (N x N, or its first
            /// columns) is touched. A and B are N x k.
            symmetric::symmetric_product_lower(c: ViewMut<'_, $s>, alpha: $s, a: View<'_, $s>, b: View<'_, $s>);
            /// The part of M (phi (x) I)^T that columns `first`.. of Y (the columns of `y`) have from the stored lower
            /// triangle of the symmetric M (kn x kn; its upper triangle is zero), added to `y`; what its mirror
            /// image gives to rows b, n + b, 2n + b, .. of Y for the same columns b stands, transposed, in the k
            /// columns that each b has in `mirrored` (n x k times the columns of `y`).
            symmetric::block_product_lower(
                m: View<'_, $s>, phi: &[$s], first: usize, y: ViewMut<'_, $s>, mirrored: ViewMut<'_, $s>
            );
            /// Adds what [`Kernels::block_product_lower`] has left in `mirrored` (n x k times some columns, of which
            /// the first is column `row` of Y) to rows `row`.. of each of the k blocks of columns `first`.. of Y, the
            /// columns of `y` (kn rows).
            symmetric::add_mirrored(mirrored: View<'_, $s>, k: usize, row: usize, first: usize, y: ViewMut<'_, $s>);
            /// X <- X + (phi^T (x) I) Theta: to each column of X (n x c) the weighted sum of the k blocks of n entries
            /// in that column of Theta (kn x c).
            symmetric::add_block_sums(x: ViewMut<'_, $s>, theta: View<'_, $s>, phi: &[$s]);
            /// OUT <- OUT + sum_st W_st M_st over the n x n blocks M_st of a symmetric M (kn x kn) of which the lower
            /// triangle is stored, with zeros above it; W (k x k) is symmetric. Only the lower triangle of OUT is
            /// meant. `work` holds n x n.
            symmetric::add_weighted_blocks_lower(
                m: View<'_, $s>, weights: View<'_, $s>, out: ViewMut<'_, $s>, work: ViewMut<'_, $s>
            );
            /// K = M (L L^T)^-1 for M (N x k) and the lower Cholesky factor L (k x k).
            symmetric::solve_gain(cross: View<'_, $s>, factor: View<'_, $s>, gain: ViewMut<'_, $s>);
            /// X <- Abar X for Abar = J + sum_k abar_k e_{c_k}^T: `rows` are the c_k, `abar` (n x p) holds the abar_k.
            /// `work` holds p entries.
            symmetric::advance_columns(
                x: ViewMut<'_, $s>, shift: &Shift, rows: &[usize], abar: View<'_, $s>, work: &mut [$s]
            );
            /// X <- X Abar^T (N x n) for the same Abar. `kept` holds N x p.
            symmetric::advance_rows(
                x: ViewMut<'_, $s>, shift: &Shift, rows: &[usize], abar: View<'_, $s>, kept: ViewMut<'_, $s>
            );
            /// Takes the rows of H U (k x N, one a measurement) through all updates of U diag(d) U^T: `spreads` (the
            /// innovations' variances; before, those of the noise) and `d` as after them, and the two numbers of each
            /// update and column into `changes` (2k x N). Column i of `gains` (k x k), below its diagonal, becomes the
            /// gain of update i times its spread, seen through the later rows of H.
            measurement::bierman_recursion(
                rows: ViewMut<'_, $s>, spreads: &mut [$s], d: &mut [$s], changes: ViewMut<'_, $s>, gains: ViewMut<'_,
                    $s>
            );
            /// Takes the rows of a panel through all updates. `changes` has the panel's columns; `gains` (the panel's
            /// rows x k) is overwritten by the gains times their spreads.
            measurement::bierman_sweep(panel: ViewMut<'_, $s>, changes: View<'_, $s>, gains: ViewMut<'_, $s>);
            /// The measurement recursion for S S^T, with standard deviations as spreads; `d` is not used.
            measurement::givens_recursion(
                rows: ViewMut<'_, $s>, spreads: &mut [$s], d: &mut [$s], changes: ViewMut<'_, $s>, gains: ViewMut<'_,
                    $s>
            );
            /// Takes the rows of a panel of S through all updates, as `bierman_sweep` does for U D U^T.
            measurement::givens_sweep(panel: ViewMut<'_, $s>, changes: View<'_, $s>, gains: ViewMut<'_, $s>);
            /// U diag(d) U^T + c a a^T for an a (a column a panel) with no entry after `place`; `a` is destroyed.
            rank_one::agee_turner(
                layout: PanelLayout, u: ViewMut<'_, $s>, d: &mut [$s], a: ViewMut<'_, $s>, place: usize, c: $s
            );
            /// S S^T + a a^T for an a (a column a panel) with no entry after `place`; `a` is destroyed.
            rank_one::rotate_in(layout: PanelLayout, s: ViewMut<'_, $s>, a: ViewMut<'_, $s>, place: usize);
            /// Advances columns of the first panel, from column `first` on, x: [Abar Ux, Abar Uxt + (phi (x) I) Ut]
            /// with the panels from the second one on in `theta`. J is given as a sum of shifts: column i of `shifts`
            /// (a panel's rows x s) has a one in the rows in which the one of J stands `offsets[i]` before the
            /// diagonal. `outputs` are the rows c_k, `abar` (a panel's rows x p) holds the abar_k, `work` p entries.
            panels::advance_panel(
                layout: PanelLayout, theta: View<'_, $s>, phi: &[$s], offsets: &[usize], shifts: View<'_, $s>,
                outputs: &[usize], abar: View<'_, $s>, first: usize, x: ViewMut<'_, $s>, work: &mut [$s]
            );
            /// OUT (N x k) <- U diag(d) U^T H^T, H picking these rows, all of the first panel.
            output_columns::output_columns(
                layout: PanelLayout, u: View<'_, $s>, d: &[$s], rows: &[usize], out: ViewMut<'_, $s>
            );
            /// SUM <- SUM + sum_k V_k diag(d) V_k^T, lower triangle, V_k = sum_s l(s, k) U_s over the columns from ..
            /// to of the panels U_s in `theta` (those from the second one on; columns count from the first of them).
            /// SUM has a panel's rows and columns; `work` has a panel's rows and [`DEPTH`](crate::kernels::DEPTH)
            /// columns.
            parameter_blocks::add_parameter_blocks(
                layout: PanelLayout, theta: View<'_, $s>, d: &[$s], factor: View<'_, $s>, from: usize, to: usize,
                sum: ViewMut<'_, $s>, work: ViewMut<'_, $s>
            );
            /// Q = V diag(d) V^T with V unit upper triangular, from the last row up, by its stored lower triangle: V
            /// into `v`, whose rows from n on become zero. A pivot of at most `zero` times its diagonal entry (or not a
            /// number) is given as zero, and its column of V too. `work` holds n entries.
            gram_schmidt::upper_ldl(q: View<'_, $s>, v: ViewMut<'_, $s>, d: &mut [$s], zero: $s, work: &mut [$s]);
            /// Modified weighted Gram-Schmidt (Thornton; Bierman 1977, ch. VI) of the first n rows of W (n x r),
            /// whose columns have these weights: U unit upper triangular and d with U diag(d) U^T = W diag(weights)
            /// W^T. W may have further rows; those of U are then zero. `w` is destroyed; `work` has 4r + rows(W)
            /// entries.
            gram_schmidt::weighted_gram_schmidt(
                w: ViewMut<'_, $s>, support: Support<'_>, weights: &[$s], u: ViewMut<'_, $s>, d: &mut [$s],
                    work: &mut [$s]
            );
            /// The upper triangular S (n x n) with S S^T = W W^T, by Householder reflections of the columns of W (n x
            /// r, r >= n). W may have further rows; those of S are then zero. `w` is destroyed; `work` has 2r + rows(W)
            /// entries.
            householder::triangular_factor(
                w: ViewMut<'_, $s>, n: usize, tails: Tails<'_>, s: ViewMut<'_, $s>, work: &mut [$s]
            );
        }
    };
}

macro_rules! declare {
    ($s:ty; $($(#[$doc:meta])* $file:ident::$name:ident($($argument:ident: $type:ty),* $(,)?);)*) => {
        /// A scalar with its kernels. An implementation for another scalar may be empty: the bodies here are plain
        /// loops.
        pub trait Kernels: Scalar {
            $($(#[$doc])* #[allow(clippy::too_many_arguments)] fn $name($($argument: $type),*) {
                $file::$name($($argument),*)
            })*
        }
    };
}

macro_rules! compile {
    ($s:ty; $($(#[$doc:meta])* $file:ident::$name:ident($($argument:ident: $type:ty),* $(,)?);)*) => {
        impl Kernels for $s {
            $(fn $name($($argument: $type),*) {
                #[allow(clippy::too_many_arguments)]
                #[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+fma", "x86_64+avx2+fma"))]
                fn compiled($($argument: $type),*) {
                    $file::$name($($argument),*)
                }
                compiled($($argument),*)
            })*
        }
    };
}

each_kernel!(declare, Self);
each_kernel!(compile, f64);
each_kernel!(compile, f32);

impl Kernels for qd::Quad {}
