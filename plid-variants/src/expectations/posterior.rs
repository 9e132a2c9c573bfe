//! The expectation of Eq. 8-10 with psi = Z^k for the parameters only, with estimates and covariances after the
//! measurement.

use plid_core::kernels::Kernels;
use plid_core::{
    ConditionalExpectations, CovarianceBlocks, Dense, Expectation, FormFacts, ImplicitModel, Matrix, StepSize,
    StepView, Term, Transition,
};

use super::{Scratch, condition_on_sensor_noise, regress_on_measurement, unconditioned_flops, unconditioned_weights};

/// The expectation of Eq. 8-10 with psi = Z^k for the parameters only, with estimates and covariances after the
/// measurement.
#[derive(Clone, Debug)]
pub struct Posterior<S> {
    scratch: Scratch<S>,
    weights: Dense<S>,
}

impl<S: Kernels> ConditionalExpectations for Posterior<S> {
    type Scalar = S;
    type Options = ();

    fn new(model: &dyn ImplicitModel, _: &()) -> Self {
        let columns = model.parameter_columns();
        Self { scratch: Scratch::new(model), weights: Dense::zeros(columns, columns) }
    }

    fn after(
        &mut self,
        step: &StepView<'_, S>,
        covariance: &mut dyn CovarianceBlocks<S>,
        transition: &mut Transition<S>,
    ) {
        condition_on_sensor_noise(step, &mut self.scratch, transition);
        unconditioned_weights(step, &mut self.weights);
        covariance.add_parameter_blocks(&self.weights, transition.qbar.view_mut());
        regress_on_measurement(step, transition);
    }
}

impl<S: Kernels> Expectation for Posterior<S> {
    const FLOPS: fn(&StepSize, &FormFacts) -> Vec<Term> = unconditioned_flops;
}
