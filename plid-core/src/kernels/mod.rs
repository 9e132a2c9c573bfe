//! The loops over slices and small matrices of which the recursion consists.
//!
//! The loops in which a step spends its time are methods of [`Kernels`]; the short loops below are for general use.

mod cholesky;
mod compiled;
mod gram_schmidt;
mod householder;
mod measurement;
mod output_columns;
mod pack;
mod panels;
mod parameter_blocks;
mod rank_one;
mod shift;
mod symmetric;

pub use cholesky::{BadPivot, cholesky, pivoted_cholesky, semidefinite_ldl, solve_lower};
pub use compiled::Kernels;
pub use gram_schmidt::Support;
pub use householder::Tails;
pub use measurement::hypotenuse;
pub use pack::Pack;
pub use panels::PanelLayout;
pub use parameter_blocks::DEPTH;
pub use shift::Shift;

use crate::Scalar;

/// Computes y += alpha x.
#[inline]
pub fn axpy<S: Scalar>(alpha: S, x: &[S], y: &mut [S]) {
    for (y, &x) in y.iter_mut().zip(x) {
        *y += alpha * x;
    }
}

/// Returns the sum of x_i y_i, in four partial sums so that the loop vectorises.
#[inline]
pub fn dot<S: Scalar>(x: &[S], y: &[S]) -> S {
    let mut sums = [S::zero(); 4];
    let (xs, ys) = (x.chunks_exact(4), y[..x.len()].chunks_exact(4));
    let tail = xs.remainder().iter().zip(ys.remainder()).fold(S::zero(), |t, (&a, &b)| t + a * b);
    for (a, b) in xs.zip(ys) {
        for k in 0..4 {
            sums[k] += a[k] * b[k];
        }
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + tail
}
