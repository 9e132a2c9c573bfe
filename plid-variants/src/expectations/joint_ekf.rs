//! The joint extended Kalman filter, which linearises the model about x+ and theta+.

use plid_core::kernels::Kernels;
use plid_core::{
    ConditionalExpectations, CovarianceBlocks, Expectation, FormFacts, ImplicitModel, StepSize, StepView, Term,
    Transition,
};

use super::{Scratch, condition_on_sensor_noise, noise_flops, regress_on_estimate};

/// The joint extended Kalman filter, which linearises the model about x+ and theta+.
#[derive(Clone, Debug)]
pub struct JointEkf<S> {
    scratch: Scratch<S>,
}

impl<S: Kernels> ConditionalExpectations for JointEkf<S> {
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
        regress_on_estimate(step, transition);
    }
}

impl<S: Kernels> Expectation for JointEkf<S> {
    const FLOPS: fn(&StepSize, &FormFacts) -> Vec<Term> = noise_flops;
}
