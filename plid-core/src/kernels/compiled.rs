//! The kernels that a step spends its time in, as methods of the scalar.
//!
//! Their bodies are generic, and stand in the files beside this one. `f32` and `f64` have them compiled here and nowhere else, once for each
//! of several instruction sets (`multiversion`), of which the best that the CPU has is chosen at run time: a plain build is
//! already fast, and a crate that uses them does not compile them again. Fused multiply-adds, and sums whose order does
//! not depend on the width of the registers, give the same bits on all of them.

use crate::{Scalar, View, ViewMut};

use super::{Shift, symmetric};

/// Hands the list of all kernels, for the scalar `$s`, to the macro `$make`. A new kernel is one entry here and its body.
macro_rules! each_kernel {
    ($make:ident, $s:ty) => {
        $make! {
            $s;
            /// C <- C + alpha A B^T for a product that is symmetric; only the lower triangle of C (N x N, or its first
            /// columns) is touched. A and B are N x k.
            symmetric::symmetric_product_lower(c: ViewMut<'_, $s>, alpha: $s, a: View<'_, $s>, b: View<'_, $s>);
            /// The part of M (phi (x) I)^T that columns `first`.. of Y (the columns of `y`) have from the stored lower triangle of the
            /// symmetric M (kn x kn; zeros stand above its diagonal), added to `y`; what its mirror image gives to rows b, n + b, 2n + b, .. of Y for
            /// the same columns b stands, transposed, in the k columns that each b has in `mirrored` (n x k times the columns of `y`).
            symmetric::block_product_lower(
                m: View<'_, $s>, phi: &[$s], first: usize, y: ViewMut<'_, $s>, mirrored: ViewMut<'_, $s>
            );
            /// Adds what [`Kernels::block_product_lower`] has left in `mirrored` (n x k times some columns, of which the first is
            /// column `row` of Y) to rows `row`.. of each of the k blocks of columns `first`.. of Y, the columns of `y` (kn rows).
            symmetric::add_mirrored(mirrored: View<'_, $s>, k: usize, row: usize, first: usize, y: ViewMut<'_, $s>);
            /// X <- X + (phi^T (x) I) Theta: to each column of X (n x c) the weighted sum of the k blocks of n entries in that
            /// column of Theta (kn x c).
            symmetric::add_block_sums(x: ViewMut<'_, $s>, theta: View<'_, $s>, phi: &[$s]);
            /// OUT <- OUT + sum_st W_st M_st over the n x n blocks M_st of a symmetric M (kn x kn) of which the lower triangle is
            /// stored, with zeros above it; W (k x k) is symmetric. Only the lower triangle of OUT is meant. `work` holds n x n.
            symmetric::add_weighted_blocks_lower(
                m: View<'_, $s>, weights: View<'_, $s>, out: ViewMut<'_, $s>, work: ViewMut<'_, $s>
            );
            /// K = M (L L^T)^-1 for M (N x k) and the lower Cholesky factor L (k x k).
            symmetric::solve_gain(cross: View<'_, $s>, factor: View<'_, $s>, gain: ViewMut<'_, $s>);
            /// X <- Abar X for Abar = J + sum_k abar_k e_{c_k}^T: `rows` are the c_k, `abar` (n x p) holds the abar_k. `work` holds p entries.
            symmetric::advance_columns(
                x: ViewMut<'_, $s>, shift: &Shift, rows: &[usize], abar: View<'_, $s>, work: &mut [$s]
            );
            /// X <- X Abar^T (N x n) for the same Abar. `kept` holds N x p.
            symmetric::advance_rows(
                x: ViewMut<'_, $s>, shift: &Shift, rows: &[usize], abar: View<'_, $s>, kept: ViewMut<'_, $s>
            );
        }
    };
}

macro_rules! declare {
    ($s:ty; $($(#[$doc:meta])* $file:ident::$name:ident($($argument:ident: $type:ty),* $(,)?);)*) => {
        /// A scalar with its kernels. An implementation for another scalar may be empty: the bodies here are plain loops.
        pub trait Kernels: Scalar {
            $($(#[$doc])* fn $name($($argument: $type),*) {
                $file::$name($($argument),*)
            })*
        }
    };
}

macro_rules! compile {
    ($s:ty; $($(#[$doc:meta])* $file:ident::$name:ident($($argument:ident: $type:ty),* $(,)?);)*) => {
        impl Kernels for $s {
            $(fn $name($($argument: $type),*) {
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
