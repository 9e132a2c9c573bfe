//! The kernels in which a step spends its time, as methods of the scalar.
//!
//! Their bodies are generic and are in the other files of this folder. For `f32` and `f64` they are compiled only
//! here, once for each of several instruction sets (`multiversion`), and the best set that the CPU has is chosen at
//! run time. Therefore a plain build is already fast, and a crate that uses the kernels does not compile them again.
//! The results are bit-identical with all instruction sets, because the multiply-adds are fused and the order of the
//! sums does not depend on the width of the registers.

use crate::{Scalar, View, ViewMut};

use super::gram_schmidt::Support;
use super::householder::Tails;
use super::panels::PanelLayout;
use super::{
    Shift, gram_schmidt, householder, measurement, output_columns, panels, parameter_blocks, rank_one, symmetric,
};

/// Passes the list of all kernels, for the scalar `$s`, to the macro `$make`. A new kernel requires an entry here and
/// its body.
macro_rules! each_kernel {
    ($make:ident, $s:ty) => {
        $make! {
            $s;
            /// Computes C <- C + alpha A B^T for a product that is symmetric. Only the lower triangle of C (N x N, or
            /// its first columns) is changed. A and B are N x k.
            symmetric::symmetric_product_lower(c: ViewMut<'_, $s>, alpha: $s, a: View<'_, $s>, b: View<'_, $s>);
            /// Adds to `y` (columns `first`.. of Y) the contribution of the stored lower triangle of the symmetric M
            /// (kn x kn; its upper triangle is zero) to Y = M (phi (x) I)^T. For each of these columns b, the mirror
            /// image of the triangle contributes to rows b, n + b, 2n + b, .. of Y. This part is written, transposed,
            /// to the k columns that each b has in `mirrored` (n x k times the columns of `y`).
            symmetric::block_product_lower(
                m: View<'_, $s>, phi: &[$s], first: usize, y: ViewMut<'_, $s>, mirrored: ViewMut<'_, $s>
            );
            /// Adds the part that [`Kernels::block_product_lower`] has written to `mirrored` (n x k times some
            /// columns, of which the first is column `row` of Y) to `y` (kn rows, columns `first`.. of Y), in rows
            /// `row`.. of each of the k blocks of rows.
            symmetric::add_mirrored(mirrored: View<'_, $s>, k: usize, row: usize, first: usize, y: ViewMut<'_, $s>);
            /// Computes X <- X + (phi^T (x) I) Theta: adds to each column of X (n x c) the weighted sum of the k
            /// blocks of n entries in that column of Theta (kn x c).
            symmetric::add_block_sums(x: ViewMut<'_, $s>, theta: View<'_, $s>, phi: &[$s]);
            /// Computes OUT <- OUT + sum_st W_st M_st over the n x n blocks M_st of a symmetric M (kn x kn) whose
            /// lower triangle is stored, with zeros above it. W (k x k) is symmetric. Only the lower triangle of OUT
            /// is meaningful. `work` is n x n.
            symmetric::add_weighted_blocks_lower(
                m: View<'_, $s>, weights: View<'_, $s>, out: ViewMut<'_, $s>, work: ViewMut<'_, $s>
            );
            /// Computes K = M (L L^T)^-1 for M (N x k) and the lower Cholesky factor L (k x k).
            symmetric::solve_gain(cross: View<'_, $s>, factor: View<'_, $s>, gain: ViewMut<'_, $s>);
            /// Computes X <- Abar X for Abar = J + sum_k abar_k e_{c_k}^T. `rows` are the c_k, `abar` (n x p) holds
            /// the abar_k, and `work` has p entries.
            symmetric::advance_columns(
                x: ViewMut<'_, $s>, shift: &Shift, rows: &[usize], abar: View<'_, $s>, work: &mut [$s]
            );
            /// Computes X <- X Abar^T (N x n) for the same Abar. `kept` is N x p.
            symmetric::advance_rows(
                x: ViewMut<'_, $s>, shift: &Shift, rows: &[usize], abar: View<'_, $s>, kept: ViewMut<'_, $s>
            );
            /// Takes the rows of H U (k x N, one per measurement) through all updates of U diag(d) U^T. `spreads`
            /// (the variances of the noise before, and of the innovations after) and `d` are updated, and `changes`
            /// (2k x N) receives the two numbers of each update and column. Column i of `gains` (k x k), below its
            /// diagonal, becomes the gain of update i times its spread, multiplied by the later rows of H.
            measurement::bierman_recursion(
                rows: ViewMut<'_, $s>, spreads: &mut [$s], d: &mut [$s], changes: ViewMut<'_, $s>, gains: ViewMut<'_,
                    $s>
            );
            /// Takes the rows of a panel through all updates. The columns of `changes` are those of the panel;
            /// `gains` (the panel's rows x k) is overwritten with the gains times their spreads.
            measurement::bierman_sweep(panel: ViewMut<'_, $s>, changes: View<'_, $s>, gains: ViewMut<'_, $s>);
            /// Does the same as `bierman_recursion` for S S^T, with standard deviations as spreads; `d` is not
            /// changed.
            measurement::givens_recursion(
                rows: ViewMut<'_, $s>, spreads: &mut [$s], d: &mut [$s], changes: ViewMut<'_, $s>, gains: ViewMut<'_,
                    $s>
            );
            /// Takes the rows of a panel of S through all updates, as `bierman_sweep` does for U D U^T.
            measurement::givens_sweep(panel: ViewMut<'_, $s>, changes: View<'_, $s>, gains: ViewMut<'_, $s>);
            /// Adds c a a^T to U diag(d) U^T, where a (one column per panel) has no entry after `place`. `a` is
            /// destroyed.
            rank_one::agee_turner(
                layout: PanelLayout, u: ViewMut<'_, $s>, d: &mut [$s], a: ViewMut<'_, $s>, place: usize, c: $s
            );
            /// Adds a a^T to S S^T, where a (one column per panel) has no entry after `place`. `a` is destroyed.
            rank_one::rotate_in(layout: PanelLayout, s: ViewMut<'_, $s>, a: ViewMut<'_, $s>, place: usize);
            /// Advances the columns x of the first panel, from column `first` on, to
            /// [Abar Ux, Abar Uxt + (phi (x) I) Ut], with the panels from the second one on in `theta`. J is given as
            /// a sum of shifts: column i of `shifts` (a panel's rows x s) has a one in each row in which J has its one
            /// `offsets[i]` columns before the diagonal. `outputs` are the rows c_k, `abar` (a panel's rows x p) holds
            /// the abar_k, and `work` has p entries.
            panels::advance_panel(
                layout: PanelLayout, theta: View<'_, $s>, phi: &[$s], offsets: &[usize], shifts: View<'_, $s>,
                outputs: &[usize], abar: View<'_, $s>, first: usize, x: ViewMut<'_, $s>, work: &mut [$s]
            );
            /// Computes OUT (N x k) <- U diag(d) U^T H^T, where H selects these rows, all of them in the first panel.
            output_columns::output_columns(
                layout: PanelLayout, u: View<'_, $s>, d: &[$s], rows: &[usize], out: ViewMut<'_, $s>
            );
            /// Adds sum_k V_k diag(d) V_k^T to the lower triangle of SUM, where V_k = sum_s l(s, k) U_s over the
            /// columns from .. to of the panels U_s in `theta` (those from the second one on; columns count from the
            /// first of them), and l is `factor`. SUM has a panel's rows and columns; `work` has a panel's rows and
            /// [`DEPTH`](crate::kernels::DEPTH) columns.
            parameter_blocks::add_parameter_blocks(
                layout: PanelLayout, theta: View<'_, $s>, d: &[$s], factor: View<'_, $s>, from: usize, to: usize,
                sum: ViewMut<'_, $s>, work: ViewMut<'_, $s>
            );
            /// Computes Q = V diag(d) V^T with V unit upper triangular, from the last row up and from the stored
            /// lower triangle of Q. V is written to `v`, whose rows from n on become zero. A pivot of at most `zero`
            /// times its diagonal entry (or not a number) becomes zero, as does its column of V. `work` has n entries.
            gram_schmidt::upper_ldl(q: View<'_, $s>, v: ViewMut<'_, $s>, d: &mut [$s], zero: $s, work: &mut [$s]);
            /// Computes the unit upper triangular U and the d with U diag(d) U^T = W diag(weights) W^T by modified
            /// weighted Gram-Schmidt orthogonalisation (Thornton; Bierman 1977, ch. VI) of the first n rows of W (n x
            /// r). If W has further rows, those of U are zero. `w` is destroyed; `work` has 4r + rows(W) entries.
            gram_schmidt::weighted_gram_schmidt(
                w: ViewMut<'_, $s>, support: Support<'_>, weights: &[$s], u: ViewMut<'_, $s>, d: &mut [$s],
                    work: &mut [$s]
            );
            /// Computes the upper triangular S (n x n) with S S^T = W W^T by Householder reflections of the columns
            /// of W (n x r, r >= n). If W has further rows, those of S are zero. `w` is destroyed; `work` has 2r +
            /// rows(W) entries.
            householder::triangular_factor(
                w: ViewMut<'_, $s>, n: usize, tails: Tails<'_>, s: ViewMut<'_, $s>, work: &mut [$s]
            );
        }
    };
}

macro_rules! declare {
    ($s:ty; $($(#[$doc:meta])* $file:ident::$name:ident($($argument:ident: $type:ty),* $(,)?);)*) => {
        /// A scalar with its kernels. The implementation for another scalar may be empty, because the bodies here are
        /// plain loops.
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
