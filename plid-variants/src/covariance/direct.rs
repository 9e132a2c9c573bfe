//! The covariance as in Eq. 8-10: P - K Re K^T, F P F^T + E[G Q0 G^T].

use plid_core::kernels::axpy;
use plid_core::{Scalar, ViewMut};

use super::symmetric::{Innovations, Symmetric, UpdateRule};

/// Direct propagation (Eq. 8-10) in two phases.
pub type Direct<B> = Symmetric<B, DirectRule>;

/// P+ = P - K Re K^T.
#[derive(Clone, Copy, Debug)]
pub struct DirectRule;

impl UpdateRule for DirectRule {
    const CORRECTIONS: usize = 1;

    fn correction<S: Scalar>(
        _which: usize,
        innovations: Innovations<'_, S>,
        mut left: ViewMut<'_, S>,
        mut right: ViewMut<'_, S>,
    ) {
        let k = innovations.gain.columns();
        // K L twice, which gives an exactly symmetric product.
        for j in 0..k {
            let column = left.column_mut(j);
            column.fill(S::zero());
            for i in j..k {
                axpy(innovations.factor.at(i, j), innovations.gain.column(i), column);
            }
            right.column_mut(j).copy_from_slice(column);
        }
    }
}
