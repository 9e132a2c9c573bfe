//! The trait of the conditional expectations E[G] and E[G Q0 G^T]: what is taken as known of the parameters when the noise enters.

use crate::{CovariancePropagation, ImplicitModel, NoiseTerms, ScalarOf, Transition};

/// What a conditional expectation may look at.
#[derive(Debug)]
pub struct Moment<'a, S, M> {
    /// The structure.
    pub model: &'a M,
    /// The noise, for the outputs that are there.
    pub noise: &'a NoiseTerms<S>,
    /// The estimate of s = [x; theta], N entries, at the moment of the call.
    pub s: &'a [S],
    /// The measurement z_k, p entries; those of missing outputs mean nothing.
    pub z: &'a [S],
    /// The input u_k, m entries.
    pub u: &'a [S],
    /// r = z - C x after the measurement update, one entry an available output; before it, the innovation.
    pub residual: &'a [S],
}

/// `E[G]`, `E[G Q0 G^T]`, the regressor and the drift (plid-mathematics, sections 4 and 5).
///
/// The two calls of a step fill one [`Transition`] between them: `before` sees s- and P-, `after` sees s+ and P+. Neither allocates.
pub trait ConditionalExpectations<C: CovariancePropagation>: Clone + Send + Sync + Sized + 'static {
    /// Scratch space for the shapes of `model`.
    fn new(model: &impl ImplicitModel) -> Self;

    /// Before the measurement update; most expectations have no need of it.
    fn before<M: ImplicitModel>(
        &mut self,
        _moment: &Moment<'_, ScalarOf<C>, M>,
        _covariance: &mut C,
        _transition: &mut Transition<ScalarOf<C>>,
    ) {
    }

    /// After the measurement update.
    fn after<M: ImplicitModel>(
        &mut self,
        moment: &Moment<'_, ScalarOf<C>, M>,
        covariance: &mut C,
        transition: &mut Transition<ScalarOf<C>>,
    );
}
