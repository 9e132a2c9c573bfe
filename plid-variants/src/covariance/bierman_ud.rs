//! P = U D U^T: Bierman's measurement update, Thornton's time update (Bierman 1977, ch. V and VI) restricted to the plant's states.

use num_traits::One;
use plid_core::kernels::{BadPivot, Kernels};
use plid_core::{
    Backend, CovariancePropagation, Dense, Health, ImplicitModel, InitialCovariance, Matrix, NoiseTerms, Scalar,
    ScalarOf, Transition, ViewMut,
};

use super::triangular::{Triangular, Updates};

/// Bierman's UD form with the structured Thornton update (plid-mathematics, section 6).
#[derive(Clone, Debug)]
pub struct BiermanUd<B: Backend> {
    factors: Triangular<B>,
}

/// Bierman's scalar update.
fn updates<S: Kernels>() -> Updates<S> {
    Updates { spread: |variance| variance, recursion: S::bierman_recursion, sweep: S::bierman_sweep }
}

impl<B: Backend> CovariancePropagation for BiermanUd<B> {
    type Backend = B;

    fn new(model: &impl ImplicitModel, initial: &InitialCovariance) -> Result<Self, BadPivot> {
        Ok(Self { factors: Triangular::new(model, initial)? })
    }

    fn output_columns(&self, rows: &[usize], out: ViewMut<'_, B::Scalar>) {
        self.factors.output_columns(rows, out);
    }

    fn add_parameter_blocks(&mut self, weights: &Dense<B::Scalar>, out: ViewMut<'_, B::Scalar>) {
        self.factors.add_parameter_blocks(weights, out);
    }

    fn measurement_update(
        &mut self,
        rows: &[usize],
        noise: &NoiseTerms<B::Scalar>,
        innovation: &[B::Scalar],
        s: &mut [B::Scalar],
    ) -> Result<(), BadPivot> {
        self.factors.measure(rows, noise, innovation, s, updates())
    }

    fn scalar_update(&mut self, h: &[B::Scalar], r: B::Scalar, gain: &mut [B::Scalar]) -> Result<(), BadPivot> {
        self.factors.measure_row(h, r, gain, updates())
    }

    fn time_update(&mut self, _model: &impl ImplicitModel, transition: &Transition<B::Scalar>) -> Result<(), BadPivot> {
        self.factors.time_update(transition, |corner, laid, u, d| corner.gram_schmidt::<B>(laid, u, d))?;
        self.factors.check()
    }

    fn add_parameter_noise(&mut self, q: B::Scalar, step: u64) {
        let (n, size) = (self.factors.layout.n(), self.factors.layout.size());
        let parameters = size - n;
        let place = n + (step % parameters as u64) as usize;
        self.factors.point(place, B::Scalar::one());
        let Triangular { layout, u, d, direction, .. } = &mut self.factors;
        let c = q * B::Scalar::from_f64(parameters as f64);
        B::Scalar::agee_turner(*layout, u.view_mut(), d, direction.view_mut(), place, c);
    }

    fn scale(&mut self, factor: B::Scalar) {
        self.factors.d.iter_mut().for_each(|d| *d *= factor);
    }

    fn dense(&self) -> Dense<B::Scalar> {
        self.factors.dense()
    }

    fn health(&self) -> Health {
        Health::from_pivots(self.factors.d.iter().map(|d| d.to_f64()), 0.0)
    }

    fn state(&self) -> Vec<ScalarOf<Self>> {
        self.factors.state()
    }

    fn restore(&mut self, state: &[ScalarOf<Self>]) -> bool {
        self.factors.restore(state)
    }
}
