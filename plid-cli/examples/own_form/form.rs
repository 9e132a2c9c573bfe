//! A covariance form of another crate: the direct form from outside, which offers neither forgetting nor parameter
//! noise.
//!
//! The example `own_form` runs it as a program, and the tests of the catalogue name it in configs. The names of the
//! library are those of the module above, so that it is compiled with `plid` and with the crates below it.

use super::{
    Backend, BadPivot, Checkpointed, CovariancePropagation, Dense, Direct, Form, FormFacts, ImplicitModel,
    InitialCovariance, Inspect, NoiseTerms, Scalar, Transition, ViewMut,
};

/// The direct form under another name, with the five required methods only.
pub struct Own<B: Backend>(Direct<B>);

impl<B: Backend> CovariancePropagation for Own<B> {
    type Scalar = B::Scalar;
    type Options = ();

    fn new(model: &dyn ImplicitModel, initial: &InitialCovariance, _: &()) -> Result<Self, BadPivot> {
        Ok(Self(Direct::new(model, initial, &())?))
    }
    fn output_columns(&self, rows: &[usize], out: ViewMut<'_, B::Scalar>) {
        self.0.output_columns(rows, out);
    }
    fn add_parameter_blocks(&mut self, weights: &Dense<B::Scalar>, out: ViewMut<'_, B::Scalar>) {
        self.0.add_parameter_blocks(weights, out);
    }
    fn measurement_update(
        &mut self,
        rows: &[usize],
        noise: &NoiseTerms<B::Scalar>,
        innovation: &[B::Scalar],
        s: &mut [B::Scalar],
    ) -> Result<(), BadPivot> {
        self.0.measurement_update(rows, noise, innovation, s)
    }
    fn time_update(&mut self, model: &dyn ImplicitModel, transition: &Transition<B::Scalar>) -> Result<(), BadPivot> {
        self.0.time_update(model, transition)
    }
}

impl<B: Backend> Inspect for Own<B> {
    fn dense_in<T: Scalar>(&self) -> Dense<T> {
        self.0.dense_in()
    }
}

impl<B: Backend> Checkpointed for Own<B> {
    fn state(&self) -> Vec<B::Scalar> {
        self.0.state()
    }
    fn restore(&mut self, state: &[B::Scalar]) -> bool {
        self.0.restore(state)
    }
}

impl<B: Backend> Form for Own<B> {
    const FACTS: FormFacts = Direct::<B>::FACTS;
}
