//! P = S S^T with S upper triangular, by orthogonal transformations of arrays: Givens rotations in the measurement
//! update, Householder reflections in the time update (Kailath, Sayed and Hassibi, Linear Estimation, ch. 12).

use num_traits::One;
use plid_core::kernels::{BadPivot, Kernels};
use plid_core::{Backend, Matrix, Scalar, ViewMut};

use super::corner::{Corner, Laid};
use super::factored::{FactorRule, Factored};
use super::triangular::{Triangular, Updates};

/// The array square-root form.
pub type ArraySqrt<B> = Factored<B, ArrayRule>;

/// U is S, and d = 1.
#[derive(Clone, Copy, Debug)]
pub struct ArrayRule;

impl FactorRule for ArrayRule {
    // A rotation changes two entries.
    const MEASUREMENT_FLOPS: f64 = 6.0;
    // A reflection into its own column of L leaves the rest of L unchanged: n entries.
    const TRIANGULARISATION_FLOPS: f64 = 2.0;

    fn begin<B: Backend>(factors: &mut Triangular<B>) {
        let (layout, mut u) = (factors.layout, factors.u.view_mut());
        for j in 0..layout.size() {
            let root = factors.d[j].sqrt();
            for k in 0..=j / layout.n() {
                u.column_mut(layout.column(k, j)).iter_mut().for_each(|x| *x *= root);
            }
            factors.d[j] = B::Scalar::one();
        }
    }

    fn updates<B: Backend>() -> Updates<B::Scalar> {
        Updates { spread: Scalar::sqrt, recursion: B::Scalar::givens_recursion, sweep: B::Scalar::givens_sweep }
    }

    fn triangularise<B: Backend>(
        corner: &mut Corner<B::Scalar>,
        laid: Laid,
        s: ViewMut<'_, B::Scalar>,
        _d: &mut [B::Scalar],
    ) {
        corner.reflect::<B>(laid, s);
    }

    fn check<B: Backend>(factors: &Triangular<B>) -> Result<(), BadPivot> {
        let mut pivots = (0..factors.layout.n()).map(|i| factors.at(i, i));
        match pivots.position(|pivot| !pivot.is_finite()) {
            Some(index) => Err(BadPivot { index, value: factors.at(index, index).to_f64() }),
            None => Ok(()),
        }
    }

    fn inflate<B: Backend>(factors: &mut Triangular<B>, place: usize, c: B::Scalar) {
        factors.point(place, c.sqrt());
        let Triangular { layout, u, direction, .. } = factors;
        B::Scalar::rotate_in(*layout, u.view_mut(), direction.view_mut(), place);
    }

    fn scale<B: Backend>(factors: &mut Triangular<B>, factor: B::Scalar) {
        let root = factor.sqrt();
        let mut s = factors.u.view_mut();
        for j in 0..s.columns() {
            s.column_mut(j).iter_mut().for_each(|x| *x *= root);
        }
    }

    fn pivot<B: Backend>(factors: &Triangular<B>, j: usize) -> B::Scalar {
        factors.at(j, j) * factors.at(j, j)
    }
}
