//! P = S S^T with S upper triangular, by orthogonal transformations of arrays: Givens rotations in the measurement
//! update, Householder reflections in the time update (Kailath, Sayed and Hassibi, Linear Estimation, ch. 12).

use num_traits::One;
use plid_core::kernels::{BadPivot, Kernels};
use plid_core::{
    Backend, CovariancePropagation, Dense, Health, ImplicitModel, InitialCovariance, Matrix, NoiseTerms, Scalar,
    ScalarOf, Transition, ViewMut,
};

use super::triangular::{Triangular, Updates};

/// The array square-root form. Its factors are kept with d = 1.
#[derive(Clone, Debug)]
pub struct ArraySqrt<B: Backend> {
    factors: Triangular<B>,
}

/// The scalar update by rotations.
fn updates<S: Kernels>() -> Updates<S> {
    Updates { spread: Scalar::sqrt, recursion: S::givens_recursion, sweep: S::givens_sweep }
}

impl<B: Backend> CovariancePropagation for ArraySqrt<B> {
    type Backend = B;

    fn new(model: &impl ImplicitModel, initial: &InitialCovariance) -> Result<Self, BadPivot> {
        let mut factors = Triangular::<B>::new(model, initial)?;
        let (layout, mut u) = (factors.layout, factors.u.view_mut());
        for j in 0..layout.size() {
            let root = factors.d[j].sqrt();
            for k in 0..=j / layout.n() {
                u.column_mut(layout.column(k, j)).iter_mut().for_each(|x| *x *= root);
            }
            factors.d[j] = B::Scalar::one();
        }
        Ok(Self { factors })
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
        self.factors.time_update(transition, |corner, laid, s, _| corner.reflect::<B>(laid, s))?;
        for i in 0..self.factors.layout.n() {
            let pivot = self.factors.at(i, i);
            if !pivot.is_finite() {
                return Err(BadPivot { index: i, value: pivot.to_f64() });
            }
        }
        Ok(())
    }

    fn add_parameter_noise(&mut self, q: B::Scalar, step: u64) {
        let (n, size) = (self.factors.layout.n(), self.factors.layout.size());
        let parameters = size - n;
        let place = n + (step % parameters as u64) as usize;
        self.factors.point(place, (q * B::Scalar::from_f64(parameters as f64)).sqrt());
        let Triangular { layout, u, direction, .. } = &mut self.factors;
        B::Scalar::rotate_in(*layout, u.view_mut(), direction.view_mut(), place);
    }

    fn scale(&mut self, factor: B::Scalar) {
        let root = factor.sqrt();
        let mut s = self.factors.u.view_mut();
        for j in 0..s.columns() {
            s.column_mut(j).iter_mut().for_each(|x| *x *= root);
        }
    }

    fn dense(&self) -> Dense<B::Scalar> {
        self.factors.dense()
    }

    fn health(&self) -> Health {
        let root = |j: usize| self.factors.at(j, j);
        Health::from_pivots((0..self.factors.d.len()).map(|j| (root(j) * root(j)).to_f64()), 0.0)
    }

    fn state(&self) -> Vec<ScalarOf<Self>> {
        self.factors.state()
    }

    fn restore(&mut self, state: &[ScalarOf<Self>]) -> bool {
        self.factors.restore(state)
    }
}
