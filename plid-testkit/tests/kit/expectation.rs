//! The check of expectations passes plid's own, and does not pass one that breaks a rule.

use plid_core::{ConditionalExpectations, CovarianceBlocks, ImplicitModel, StepView, Transition};
use plid_testkit::check_expectation;
use plid_variants::expectations::MomentMatched;

#[test]
fn moment_matching_conforms() {
    check_expectation::<MomentMatched<f64>>();
}

/// Moment matching that allocates in every step.
struct Allocating(MomentMatched<f64>, Vec<f64>);

impl ConditionalExpectations for Allocating {
    type Scalar = f64;
    type Options = ();

    fn new(model: &dyn ImplicitModel, _: &()) -> Self {
        Self(MomentMatched::new(model, &()), Vec::new())
    }

    fn after(
        &mut self,
        step: &StepView<'_, f64>,
        covariance: &mut dyn CovarianceBlocks<f64>,
        transition: &mut Transition<f64>,
    ) {
        self.1 = step.s.to_vec();
        self.0.after(step, covariance, transition);
    }
}

#[test]
#[should_panic(expected = "allocations")]
fn a_step_that_allocates_does_not_conform() {
    check_expectation::<Allocating>();
}
