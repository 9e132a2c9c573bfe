//! P = U D U^T: Bierman's measurement update, Thornton's time update (Bierman 1977, ch. V and VI) restricted to the plant's states.

use num_traits::{One, Zero};
use plid_core::kernels::BadPivot;
use plid_core::{
    Backend, CovariancePropagation, Dense, Health, ImplicitModel, InitialCovariance, Matrix, NoiseTerms, Scalar,
    ScalarOf, Transition, ViewMut,
};

use super::triangular::Triangular;

/// Bierman's UD form with the structured Thornton update (plid-mathematics, section 6).
#[derive(Clone, Debug)]
pub struct BiermanUd<B: Backend> {
    factors: Triangular<B>,
}

/// Bierman's update of column j of U (the entries above the diagonal) and of d_j; `variance` is r plus the sum of f_i d_i f_i so far, and
/// `gain` gathers U D f.
#[inline]
fn pass<S: Scalar>(f: S, variance: &mut S, column: &mut [S], d: &mut S, gain: &mut [S]) {
    let j = column.len() - 1;
    let g = *d * f;
    let before = *variance;
    *variance = before + f * g;
    if *variance == S::zero() {
        return;
    }
    *d *= before / *variance;
    // With nothing gathered so far the gain is zero, and so is what it takes off.
    let lambda = if before == S::zero() { S::zero() } else { -f / before };
    for (u, k) in column[..j].iter_mut().zip(&mut gain[..j]) {
        let old = *u;
        *u = old + lambda * *k;
        *k += g * old;
    }
    gain[j] = g;
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
        self.factors.measure(rows, noise, innovation, s, |variance| variance, pass)
    }

    fn scalar_update(&mut self, h: &[B::Scalar], r: B::Scalar, gain: &mut [B::Scalar]) -> Result<(), BadPivot> {
        self.factors.measure_row(h, r, gain, pass)
    }

    fn time_update(&mut self, model: &impl ImplicitModel, transition: &Transition<B::Scalar>) -> Result<(), BadPivot> {
        let rows = self.factors.advance(model, transition)?;
        let Triangular { n, array, weights, work, u, d, .. } = &mut self.factors;
        let n = *n;
        weights[..n].copy_from_slice(&d[..n]);
        B::weighted_gram_schmidt(
            array.view_mut().block_mut(0, 0, rows, n),
            &weights[..rows],
            u.view_mut().block_mut(0, 0, n, n),
            &mut d[..n],
            work,
        );
        self.factors.check()
    }

    fn add_parameter_noise(&mut self, q: B::Scalar, step: u64) {
        let (n, size) = (self.factors.n, self.factors.d.len());
        let parameters = size - n;
        let place = n + (step % parameters as u64) as usize;
        let mut a = self.factors.gains.view_mut();
        let a = &mut a.column_mut(0)[..=place];
        a.fill(B::Scalar::zero());
        a[place] = B::Scalar::one();
        let mut c = q * B::Scalar::from_f64(parameters as f64);
        // Agee and Turner's update for U D U^T + c a a^T, columns from the last to the first.
        let mut u = self.factors.u.view_mut();
        for j in (0..=place).rev() {
            let (head, d) = (a[j], self.factors.d[j]);
            let sum = d + c * head * head;
            if sum == B::Scalar::zero() {
                continue;
            }
            let factor = c * head / sum;
            for (u, a) in u.column_mut(j)[..j].iter_mut().zip(&mut a[..j]) {
                *a -= head * *u;
                *u += factor * *a;
            }
            c *= d / sum;
            self.factors.d[j] = sum;
        }
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
