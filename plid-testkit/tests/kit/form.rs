//! The check of forms passes a form that has the five required methods only, and that rounds P in every time update.

use plid_backends::Plain;
use plid_core::kernels::BadPivot;
use plid_core::{
    Checkpointed, CovariancePropagation, Dense, Form, FormFacts, ImplicitModel, InitialCovariance, Inspect, NoiseTerms,
    Scalar, Transition, ViewMut,
};
use plid_testkit::check_form;
use plid_variants::covariance::Direct;

/// The direct form, without forgetting and parameter noise, and with all of P one rounding larger after a time update.
struct Rounding(Direct<Plain<f64>>);

impl CovariancePropagation for Rounding {
    type Scalar = f64;
    type Options = ();

    fn new(model: &dyn ImplicitModel, initial: &InitialCovariance, _: &()) -> Result<Self, BadPivot> {
        Ok(Self(Direct::new(model, initial, &())?))
    }
    fn output_columns(&self, rows: &[usize], out: ViewMut<'_, f64>) {
        self.0.output_columns(rows, out);
    }
    fn add_parameter_blocks(&mut self, weights: &Dense<f64>, out: ViewMut<'_, f64>) {
        self.0.add_parameter_blocks(weights, out);
    }
    fn measurement_update(
        &mut self,
        rows: &[usize],
        noise: &NoiseTerms<f64>,
        innovation: &[f64],
        s: &mut [f64],
    ) -> Result<(), BadPivot> {
        self.0.measurement_update(rows, noise, innovation, s)
    }
    fn time_update(&mut self, model: &dyn ImplicitModel, transition: &Transition<f64>) -> Result<(), BadPivot> {
        self.0.time_update(model, transition)?;
        self.0.scale(1.0 + f64::EPSILON).expect("the direct form can");
        Ok(())
    }
}

impl Inspect for Rounding {
    fn dense_in<T: Scalar>(&self) -> Dense<T> {
        self.0.dense_in()
    }
}

impl Checkpointed for Rounding {
    fn state(&self) -> Vec<f64> {
        self.0.state()
    }
    fn restore(&mut self, state: &[f64]) -> bool {
        self.0.restore(state)
    }
}

impl Form for Rounding {
    const FACTS: FormFacts = Direct::<Plain<f64>>::FACTS;
}

#[test]
fn five_methods_and_another_rounding_conform() {
    check_form::<Rounding>();
}
