//! P = S S^T with S upper triangular, by orthogonal transformations of arrays: Givens rotations in the measurement
//! update, Householder reflections in the time update (Kailath, Sayed and Hassibi, Linear Estimation, ch. 12).

use num_traits::{One, Zero};
use plid_core::kernels::BadPivot;
use plid_core::{
    Backend, CovariancePropagation, Dense, Health, ImplicitModel, InitialCovariance, Matrix, NoiseTerms, Scalar,
    ScalarOf, Transition, ViewMut,
};

use super::triangular::Triangular;

/// The array square-root form. Its factors are kept with d = 1.
#[derive(Clone, Debug)]
pub struct ArraySqrt<B: Backend> {
    factors: Triangular<B>,
}

/// The length of (a, b) without overflow.
fn hypotenuse<S: Scalar>(a: S, b: S) -> S {
    let largest = a.abs().max(b.abs());
    if largest == S::zero() {
        return largest;
    }
    let (a, b) = (a / largest, b / largest);
    largest * (a * a + b * b).sqrt()
}

/// [a, b] <- [c a + s b, c b - s a]
#[inline]
fn rotate<S: Scalar>(c: S, s: S, a: &mut [S], b: &mut [S]) {
    for (a, b) in a.iter_mut().zip(b) {
        let (x, y) = (*a, *b);
        *a = c * x + s * y;
        *b = c * y - s * x;
    }
}

/// Rotates f, the entry of h S in this column, into the innovation's standard deviation `rho`, and the column into the scaled gain.
#[inline]
fn pass<S: Scalar>(f: S, rho: &mut S, column: &mut [S], _d: &mut S, gain: &mut [S]) {
    if f == S::zero() {
        return;
    }
    let length = hypotenuse(*rho, f);
    let (c, s) = (*rho / length, f / length);
    *rho = length;
    rotate(c, s, &mut gain[..column.len()], column);
}

impl<B: Backend> CovariancePropagation for ArraySqrt<B> {
    type Backend = B;

    fn new(model: &impl ImplicitModel, initial: &InitialCovariance) -> Result<Self, BadPivot> {
        let mut factors = Triangular::<B>::new(model, initial)?;
        let mut u = factors.u.view_mut();
        for j in 0..factors.d.len() {
            let root = factors.d[j].sqrt();
            u.column_mut(j).iter_mut().for_each(|x| *x *= root);
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
        self.factors.measure(rows, noise, innovation, s, Scalar::sqrt, pass)
    }

    fn scalar_update(&mut self, h: &[B::Scalar], r: B::Scalar, gain: &mut [B::Scalar]) -> Result<(), BadPivot> {
        self.factors.measure_row(h, r.sqrt(), gain, pass)
    }

    fn time_update(&mut self, model: &impl ImplicitModel, transition: &Transition<B::Scalar>) -> Result<(), BadPivot> {
        let rows = self.factors.advance(model, transition)?;
        let Triangular { n, array, work, u, .. } = &mut self.factors;
        let n = *n;
        B::triangular_factor(array.view_mut().block_mut(0, 0, rows, n), u.view_mut().block_mut(0, 0, n, n), work);
        for i in 0..n {
            let pivot = u.view().at(i, i);
            if !pivot.is_finite() {
                return Err(BadPivot { index: i, value: pivot.to_f64() });
            }
        }
        Ok(())
    }

    fn add_parameter_noise(&mut self, q: B::Scalar, step: u64) {
        let (n, size) = (self.factors.n, self.factors.d.len());
        let parameters = size - n;
        let place = n + (step % parameters as u64) as usize;
        let mut v = self.factors.gains.view_mut();
        let v = &mut v.column_mut(0)[..=place];
        v.fill(B::Scalar::zero());
        v[place] = (q * B::Scalar::from_f64(parameters as f64)).sqrt();
        let mut u = self.factors.u.view_mut();
        for j in (0..=place).rev() {
            let length = hypotenuse(u.at(j, j), v[j]);
            if length == B::Scalar::zero() {
                continue;
            }
            let (c, s) = (u.at(j, j) / length, v[j] / length);
            rotate(c, s, &mut u.column_mut(j)[..=j], &mut v[..=j]);
        }
    }

    fn scale(&mut self, factor: B::Scalar) {
        let root = factor.sqrt();
        let mut u = self.factors.u.view_mut();
        for j in 0..u.columns() {
            u.column_mut(j)[..=j].iter_mut().for_each(|x| *x *= root);
        }
    }

    fn dense(&self) -> Dense<B::Scalar> {
        self.factors.dense()
    }

    fn health(&self) -> Health {
        let u = self.factors.u.view();
        Health::from_pivots((0..u.columns()).map(|j| (u.at(j, j) * u.at(j, j)).to_f64()), 0.0)
    }

    fn state(&self) -> Vec<ScalarOf<Self>> {
        self.factors.state()
    }

    fn restore(&mut self, state: &[ScalarOf<Self>]) -> bool {
        self.factors.restore(state)
    }
}
