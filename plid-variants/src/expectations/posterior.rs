//! The expectation of Eq. 8-10 with psi = Z^k for the parameters only: estimates and covariances from after the measurement.

use plid_core::{
    ConditionalExpectations, CovariancePropagation, Dense, ImplicitModel, Matrix, Moment, ScalarOf, Transition,
};

use super::{Scratch, condition_on_sensor_noise, regress_on_measurement, unconditioned_weights};

/// The expectation of Eq. 8-10 with psi = Z^k for the parameters only: estimates and covariances from after the measurement.
#[derive(Clone, Debug)]
pub struct Posterior<S> {
    scratch: Scratch<S>,
    weights: Dense<S>,
}

impl<C: CovariancePropagation> ConditionalExpectations<C> for Posterior<ScalarOf<C>> {
    fn new(model: &impl ImplicitModel) -> Self {
        let columns = model.parameter_columns();
        Self { scratch: Scratch::new(model), weights: Dense::zeros(columns, columns) }
    }

    fn after<M: ImplicitModel>(
        &mut self,
        moment: &Moment<'_, ScalarOf<C>, M>,
        covariance: &mut C,
        transition: &mut Transition<ScalarOf<C>>,
    ) {
        condition_on_sensor_noise(moment, &mut self.scratch, transition);
        unconditioned_weights(moment, &mut self.weights);
        covariance.add_parameter_blocks(&self.weights, transition.qbar.view_mut());
        regress_on_measurement(moment, transition);
    }
}
