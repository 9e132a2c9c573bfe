//! The estimates from after the measurement in place of the parameters, as if they were certain: no covariances.

use plid_core::{ConditionalExpectations, CovariancePropagation, ImplicitModel, Moment, ScalarOf, Transition};

use super::{Scratch, condition_on_sensor_noise, regress_on_measurement};

/// The estimates from after the measurement in place of the parameters, as if they were certain: no covariances.
#[derive(Clone, Debug)]
pub struct CertaintyEquivalent<S> {
    scratch: Scratch<S>,
}

impl<C: CovariancePropagation> ConditionalExpectations<C> for CertaintyEquivalent<ScalarOf<C>> {
    fn new(model: &impl ImplicitModel) -> Self {
        Self { scratch: Scratch::new(model) }
    }

    fn after<M: ImplicitModel>(
        &mut self,
        moment: &Moment<'_, ScalarOf<C>, M>,
        _covariance: &mut C,
        transition: &mut Transition<ScalarOf<C>>,
    ) {
        condition_on_sensor_noise(moment, &mut self.scratch, transition);
        regress_on_measurement(moment, transition);
    }
}
