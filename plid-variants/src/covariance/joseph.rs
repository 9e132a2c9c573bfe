//! The Joseph form: P+ = (I - K H) P (I - K H)^T + K R K^T, which stays positive for any gain.

use plid_core::kernels::axpy;
use plid_core::{Scalar, ViewMut};

use super::symmetric::{Innovations, Symmetric, UpdateRule};

/// Joseph's measurement update; the time update is that of the direct form.
pub type Joseph<B> = Symmetric<B, JosephRule>;

/// With M = (I - K H) P it is P - K (H P) - (M H^T - K R) K^T: two products of N x k with k x N, never one of N x N with N x N.
#[derive(Clone, Copy, Debug)]
pub struct JosephRule;

impl UpdateRule for JosephRule {
    fn correction<S: Scalar>(
        innovations: Innovations<'_, S>,
        mut left: ViewMut<'_, S>,
        mut right: ViewMut<'_, S>,
    ) -> usize {
        let Innovations { cross, gain, output, sensor, .. } = innovations;
        let k = gain.columns();
        for j in 0..k {
            left.column_mut(j).copy_from_slice(gain.column(j));
            right.column_mut(j).copy_from_slice(cross.column(j));
            // M H^T = P H^T - K (H P H^T), then K R off it.
            let column = left.column_mut(k + j);
            column.copy_from_slice(cross.column(j));
            for i in 0..k {
                axpy(-output.at(i, j), gain.column(i), column);
            }
            for i in 0..k {
                axpy(-sensor.at(i, j), gain.column(i), column);
            }
            right.column_mut(k + j).copy_from_slice(gain.column(j));
        }
        2 * k
    }
}
