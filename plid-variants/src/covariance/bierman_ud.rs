//! P = U D U^T with Bierman's measurement update, and with Thornton's time update (Bierman 1977, ch. V and VI)
//! restricted to the plant's states.

use num_traits::One;
use plid_core::kernels::{BadPivot, Kernels};
use plid_core::{Backend, Matrix, ViewMut};

use super::corner::{Corner, Laid};
use super::factored::{FactorRule, Factored};
use super::triangular::{Triangular, Updates};

/// Bierman's UD form with the structured Thornton update.
pub type BiermanUd<B> = Factored<B, UdRule>;

/// U is unit upper triangular, and d is stored separately.
#[derive(Clone, Copy, Debug)]
pub struct UdRule;

impl FactorRule for UdRule {
    // One entry of U and one entry of the gain change.
    const MEASUREMENT_FLOPS: f64 = 4.0;
    // Gram-Schmidt processes whole rows.
    const TRIANGULARISATION_FLOPS: f64 = 8.0 / 3.0;

    fn begin<B: Backend>(_factors: &mut Triangular<B>) {}

    fn updates<B: Backend>() -> Updates<B::Scalar> {
        Updates {
            spread: |variance| variance,
            recursion: B::Scalar::bierman_recursion,
            sweep: B::Scalar::bierman_sweep,
        }
    }

    fn triangularise<B: Backend>(
        corner: &mut Corner<B::Scalar>,
        laid: Laid,
        u: ViewMut<'_, B::Scalar>,
        d: &mut [B::Scalar],
    ) {
        corner.gram_schmidt::<B>(laid, u, d);
    }

    fn check<B: Backend>(factors: &Triangular<B>) -> Result<(), BadPivot> {
        factors.check()
    }

    fn inflate<B: Backend>(factors: &mut Triangular<B>, place: usize, c: B::Scalar) {
        factors.point(place, B::Scalar::one());
        let Triangular { layout, u, d, direction, .. } = factors;
        B::Scalar::agee_turner(*layout, u.view_mut(), d, direction.view_mut(), place, c);
    }

    fn scale<B: Backend>(factors: &mut Triangular<B>, factor: B::Scalar) {
        factors.d.iter_mut().for_each(|d| *d *= factor);
    }

    fn pivot<B: Backend>(factors: &Triangular<B>, j: usize) -> B::Scalar {
        factors.d[j]
    }
}
