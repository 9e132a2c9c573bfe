//! The Joseph form: P+ = (I - K H) P (I - K H)^T + K R K^T, which stays positive for any gain.

use plid_core::kernels::axpy;
use plid_core::{Scalar, ViewMut};

use super::symmetric::{Innovations, Symmetric, UpdateRule};

/// Joseph's measurement update; the time update is that of the direct form.
pub type Joseph<B> = Symmetric<B, JosephRule>;

/// Computes M = P - K (H P), and then M - (M H^T - K R) K^T (Bierman 1977, ch. V). These are products of N x k with k
/// x N, never of N x N with N x N. M H^T must come from the rounded M. Written as P H^T - K (H P H^T) it would miss
/// the rounding errors that the second product removes.
#[derive(Clone, Copy, Debug)]
pub struct JosephRule;

impl UpdateRule for JosephRule {
    const CORRECTIONS: usize = 2;

    fn correction<S: Scalar>(
        which: usize,
        innovations: Innovations<'_, S>,
        mut left: ViewMut<'_, S>,
        mut right: ViewMut<'_, S>,
    ) {
        let Innovations { cross, gain, sensor, .. } = innovations;
        let k = gain.columns();
        for j in 0..k {
            if which == 0 {
                left.column_mut(j).copy_from_slice(gain.column(j));
                right.column_mut(j).copy_from_slice(cross.column(j));
            } else {
                let column = left.column_mut(j);
                column.copy_from_slice(cross.column(j));
                for i in 0..k {
                    axpy(-sensor.at(i, j), gain.column(i), column);
                }
                right.column_mut(j).copy_from_slice(gain.column(j));
            }
        }
    }
}
