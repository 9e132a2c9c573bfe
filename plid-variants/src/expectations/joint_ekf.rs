//! The joint extended Kalman filter: the model linearised about x+ and theta+.

use plid_core::{ConditionalExpectations, CovariancePropagation, ImplicitModel, Moment, ScalarOf, Transition};

use super::{Scratch, condition_on_sensor_noise, regress_on_estimate};

/// The joint extended Kalman filter: the model linearised about x+ and theta+.
#[derive(Clone, Debug)]
pub struct JointEkf<S> {
    scratch: Scratch<S>,
}

impl<C: CovariancePropagation> ConditionalExpectations<C> for JointEkf<ScalarOf<C>> {
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
        regress_on_estimate(moment, transition);
    }
}
