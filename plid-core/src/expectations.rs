//! The trait of the conditional expectations E[G] and E[G Q0 G^T], which determine what is taken as known of the
//! parameters when noise multiplies them.

use crate::kernels::Kernels;
use crate::{CovariancePropagation, Dense, ImplicitModel, NoiseTerms, ScalarOf, Transition, ViewMut};

/// The part of a step that a conditional expectation may read.
#[derive(Clone, Copy)]
pub struct StepView<'a, S> {
    /// The structure.
    pub model: &'a dyn ImplicitModel,
    /// The noise terms of the available outputs.
    pub noise: &'a NoiseTerms<S>,
    /// The estimate of s = [x; theta], N entries, at the time of the call.
    pub s: &'a [S],
    /// The measurement z_k, p entries; those of missing outputs are meaningless.
    pub z: &'a [S],
    /// The input u_k, m entries.
    pub u: &'a [S],
    /// The residual r = z - C x after the measurement update, with one entry per available output; before the update,
    /// the innovation.
    pub residual: &'a [S],
}

/// The blocks of P that a conditional expectation may ask for.
pub trait CovarianceBlocks<S> {
    /// Does the same as [`CovariancePropagation::output_columns`].
    fn output_columns(&self, rows: &[usize], out: ViewMut<'_, S>);

    /// Does the same as [`CovariancePropagation::add_parameter_blocks`].
    fn add_parameter_blocks(&mut self, weights: &Dense<S>, out: ViewMut<'_, S>);
}

impl<C: CovariancePropagation + ?Sized> CovarianceBlocks<ScalarOf<C>> for &mut C {
    fn output_columns(&self, rows: &[usize], out: ViewMut<'_, ScalarOf<C>>) {
        (**self).output_columns(rows, out);
    }

    fn add_parameter_blocks(&mut self, weights: &Dense<ScalarOf<C>>, out: ViewMut<'_, ScalarOf<C>>) {
        (**self).add_parameter_blocks(weights, out);
    }
}

/// The conditional expectations `E[G]` and `E[G Q0 G^T]`, the regressor and the drift.
///
/// The two calls of a step together fill one [`Transition`]: `before` receives s- and P-, and `after` receives s+ and
/// P+. They must write every field, because the transition is not cleared between steps, and they must not allocate.
pub trait ConditionalExpectations: Send + Sync + 'static {
    /// The number type.
    type Scalar: Kernels;

    /// The options of the expectation; `()` if there are none.
    type Options: Clone + Default
    where
        Self: Sized;

    /// Creates the scratch space for a model of the size of `model`.
    fn new(model: &dyn ImplicitModel, options: &Self::Options) -> Self
    where
        Self: Sized;

    /// Computes what requires the estimate before the measurement update; most expectations need nothing from it.
    fn before(
        &mut self,
        _step: &StepView<'_, Self::Scalar>,
        _covariance: &mut dyn CovarianceBlocks<Self::Scalar>,
        _transition: &mut Transition<Self::Scalar>,
    ) {
    }

    /// Computes what requires the estimate after the measurement update.
    fn after(
        &mut self,
        step: &StepView<'_, Self::Scalar>,
        covariance: &mut dyn CovarianceBlocks<Self::Scalar>,
        transition: &mut Transition<Self::Scalar>,
    );
}
