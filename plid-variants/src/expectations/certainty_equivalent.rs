//! The estimates after the measurement take the place of the parameters, as if they were certain. No covariances
//! enter.

use plid_core::kernels::Kernels;
use plid_core::{
    ConditionalExpectations, CovarianceBlocks, Expectation, FormFacts, ImplicitModel, StepSize, StepView, Term,
    Transition,
};

use super::{Scratch, condition_on_sensor_noise, noise_flops, regress_on_measurement};

/// The estimates after the measurement take the place of the parameters, as if they were certain. No covariances
/// enter.
#[derive(Clone, Debug)]
pub struct CertaintyEquivalent<S> {
    scratch: Scratch<S>,
}

impl<S: Kernels> ConditionalExpectations for CertaintyEquivalent<S> {
    type Scalar = S;
    type Options = ();

    fn new(model: &dyn ImplicitModel, _: &()) -> Self {
        Self { scratch: Scratch::new(model) }
    }

    fn after(
        &mut self,
        step: &StepView<'_, S>,
        _covariance: &mut dyn CovarianceBlocks<S>,
        transition: &mut Transition<S>,
    ) {
        condition_on_sensor_noise(step, &mut self.scratch, transition);
        regress_on_measurement(step, transition);
    }
}

impl<S: Kernels> Expectation for CertaintyEquivalent<S> {
    const FLOPS: fn(&StepSize, &FormFacts) -> Vec<Term> = noise_flops;
}
