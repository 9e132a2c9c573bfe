//! P = U diag(d) U^T with U upper triangular: what the factored forms share.
//!
//! With s = [x; theta] and the parameters constant, U = [Ux, Uxt; 0, Ut]: a time update leaves Ut alone, and Uxt becomes
//! Abar Uxt + (phi (x) I) Ut.

use num_traits::{One, Zero};
use plid_core::kernels::{self, BadPivot, axpy, pivoted_cholesky};
use plid_core::{Backend, Dense, ImplicitModel, InitialCovariance, Matrix, NoiseTerms, Scalar, Transition, ViewMut};

use super::{advance, factor_initial};

/// The factors and the scratch of their updates.
#[derive(Clone, Debug)]
pub struct Triangular<B: Backend> {
    /// U, N x N, zero below its diagonal.
    pub u: B::Matrix,
    /// d, N entries.
    pub d: Vec<B::Scalar>,
    /// n
    pub n: usize,
    /// One column a scalar measurement, N x p: the unscaled gains.
    pub gains: B::Matrix,
    /// One row a decorrelated measurement, over the available outputs: the rows of T^-1.
    pub rows: Dense<B::Scalar>,
    /// [Abar Ux, L]^T, 2n x n.
    pub array: Dense<B::Scalar>,
    /// The weights of its rows.
    pub weights: Vec<B::Scalar>,
    /// 2n entries.
    pub work: Vec<B::Scalar>,
    /// One entry a measurement.
    spreads: Vec<B::Scalar>,
    innovation: Vec<B::Scalar>,
    outputs: Vec<B::Scalar>,
    qbar: Dense<B::Scalar>,
    root: Dense<B::Scalar>,
    mix: Dense<B::Scalar>,
    mix_work: Dense<B::Scalar>,
    mix_scale: Vec<B::Scalar>,
    mixed: B::Matrix,
    mixed_weighted: B::Matrix,
}

impl<B: Backend> Triangular<B> {
    /// Factors P0.
    pub fn new(model: &impl ImplicitModel, initial: &InitialCovariance) -> Result<Self, BadPivot> {
        let (n, p, size) = (model.states(), model.outputs(), model.joint_states());
        let columns = model.parameter_columns();
        let (u0, d0) = factor_initial::<B::Scalar>(initial)?;
        let mut u = B::Matrix::zeros(size, size);
        for j in 0..size {
            u.view_mut().column_mut(j).copy_from_slice(u0.column(j));
        }
        let zero = B::Scalar::zero();
        Ok(Self {
            u,
            d: d0,
            n,
            gains: B::Matrix::zeros(size, p),
            rows: Dense::zeros(p, p),
            array: Dense::zeros(2 * n, n),
            weights: vec![B::Scalar::one(); 2 * n],
            work: vec![zero; 2 * n],
            spreads: vec![zero; p],
            innovation: vec![zero; p],
            outputs: vec![zero; p],
            qbar: Dense::zeros(n, n),
            root: Dense::zeros(n, n),
            mix: Dense::zeros(columns, columns),
            mix_work: Dense::zeros(columns, columns),
            mix_scale: vec![zero; columns],
            mixed: B::Matrix::zeros(n, size - n),
            mixed_weighted: B::Matrix::zeros(n, size - n),
        })
    }

    /// U diag(d) U^T H^T for rows of H that each pick one state.
    pub fn output_columns(&self, rows: &[usize], mut out: ViewMut<'_, B::Scalar>) {
        let u = self.u.view();
        for (k, &row) in rows.iter().enumerate() {
            let out = out.column_mut(k);
            out.fill(B::Scalar::zero());
            for j in row..u.columns() {
                axpy(self.d[j] * u.at(row, j), &u.column(j)[..=j], &mut out[..=j]);
            }
        }
    }

    /// With weights = V V^T, the sum of the blocks is a sum over V's columns v of M diag(d_theta) M^T, M = (v (x) I)^T Ut.
    pub fn add_parameter_blocks(&mut self, weights: &Dense<B::Scalar>, mut out: ViewMut<'_, B::Scalar>) {
        let (n, count) = (self.n, weights.rows());
        let size = self.u.view().rows();
        for j in 0..count {
            self.mix_work.column_mut(j).copy_from_slice(weights.column(j));
        }
        let tolerance = 16.0 * count as f64 * B::Scalar::EPSILON;
        // Weights are moments; what rounding leaves below zero is dropped.
        let (work, mix) = (self.mix_work.view_mut(), self.mix.view_mut());
        let rank = pivoted_cholesky(work, mix, &mut self.mix_scale, tolerance, f64::INFINITY).unwrap_or(0);
        for r in 0..rank {
            let v = self.mix.column(r);
            // Ut is upper triangular: columns before the first block in use are zero.
            let Some(first) = v.iter().position(|&x| x != B::Scalar::zero()) else { continue };
            let start = first * n;
            let ut = self.u.view().block(n, n, size - n, size - n);
            let (mut mixed, mut weighted) = (self.mixed.view_mut(), self.mixed_weighted.view_mut());
            for c in start..size - n {
                let (to, from) = (mixed.column_mut(c), ut.column(c));
                to.fill(B::Scalar::zero());
                for s in first..=(c / n) {
                    if v[s] != B::Scalar::zero() {
                        axpy(v[s], &from[s * n..(s + 1) * n], to);
                    }
                }
                let d = self.d[n + c];
                for (w, &x) in weighted.column_mut(c).iter_mut().zip(mixed.column(c)) {
                    *w = d * x;
                }
            }
            let a = self.mixed.view().block(0, start, n, size - n - start);
            let b = self.mixed_weighted.view().block(0, start, n, size - n - start);
            B::symmetric_product_lower(out.reborrow(), B::Scalar::one(), a, b);
        }
    }

    /// Decorrelates the outputs that are there, R = T diag(r) T^T: the rows of T^-1 into `rows`, r into `spreads`.
    fn decorrelate(&mut self, noise: &NoiseTerms<B::Scalar>) {
        let count = noise.available().len();
        for k in 0..count {
            for i in 0..count {
                *self.rows.at_mut(k, i) = if i == k { B::Scalar::one() } else { B::Scalar::zero() };
            }
            for l in 0..k {
                let factor = noise.sensor_unit(k, l);
                for i in 0..=l {
                    let known = self.rows.at(l, i);
                    *self.rows.at_mut(k, i) -= factor * known;
                }
            }
        }
        self.spreads[..count].copy_from_slice(noise.sensor_pivots());
    }

    /// The measurement update of all outputs that are there, as scalar updates. `pass` takes one of them through one column of U: given
    /// the entry f of U^T h it updates the column down to its diagonal, its d, the `spread` (the innovation's variance or its
    /// root, of the part of P gathered so far, from that of the noise on) and the gain times the spread.
    pub fn measure(
        &mut self,
        outputs: &[usize],
        noise: &NoiseTerms<B::Scalar>,
        innovation: &[B::Scalar],
        s: &mut [B::Scalar],
        spread: impl Fn(B::Scalar) -> B::Scalar,
        pass: impl Fn(B::Scalar, &mut B::Scalar, &mut [B::Scalar], &mut B::Scalar, &mut [B::Scalar]),
    ) -> Result<(), BadPivot> {
        self.decorrelate(noise);
        let count = outputs.len();
        let (mut u, mut gains) = (self.u.view_mut(), self.gains.view_mut());
        for k in 0..count {
            gains.column_mut(k).fill(B::Scalar::zero());
            self.spreads[k] = spread(self.spreads[k]);
        }
        // All scalar updates of a column while it is in the cache: update k needs nothing of the later columns.
        for j in 0..u.columns() {
            let column = &mut u.column_mut(j)[..=j];
            for k in 0..count {
                let f = Self::output_entry(&self.rows, k, outputs, column);
                pass(f, &mut self.spreads[k], column, &mut self.d[j], gains.column_mut(k));
            }
        }
        for k in 0..count {
            unscale(k, self.spreads[k], gains.column_mut(k))?;
        }
        self.correct_estimate(outputs, innovation, s);
        Ok(())
    }

    /// One scalar update with any row h; `spread` is that of the noise.
    pub fn measure_row(
        &mut self,
        h: &[B::Scalar],
        mut spread: B::Scalar,
        gain: &mut [B::Scalar],
        pass: impl Fn(B::Scalar, &mut B::Scalar, &mut [B::Scalar], &mut B::Scalar, &mut [B::Scalar]),
    ) -> Result<(), BadPivot> {
        gain.fill(B::Scalar::zero());
        let mut u = self.u.view_mut();
        for j in 0..h.len() {
            let column = &mut u.column_mut(j)[..=j];
            let f = kernels::dot(column, &h[..=j]);
            pass(f, &mut spread, column, &mut self.d[j], gain);
        }
        unscale(0, spread, gain)
    }

    /// The estimate after scalar updates with the gains in `gains` (scaled), one after the other.
    fn correct_estimate(&mut self, outputs: &[usize], innovation: &[B::Scalar], s: &mut [B::Scalar]) {
        let count = outputs.len();
        for k in 0..count {
            self.innovation[k] = (0..count).fold(B::Scalar::zero(), |sum, i| sum + self.rows.at(k, i) * innovation[i]);
        }
        for k in 0..count {
            let e = self.innovation[k];
            let gains = self.gains.view();
            let gain = gains.column(k);
            axpy(e, gain, s);
            // What this correction has already done to the innovations to come.
            for l in k + 1..count {
                let seen = outputs
                    .iter()
                    .enumerate()
                    .fold(B::Scalar::zero(), |sum, (i, &row)| sum + self.rows.at(l, i) * gain[row]);
                self.innovation[l] -= seen * e;
            }
        }
    }

    /// Advances Uxt, and lays [Abar Ux, L]^T with L L^T = Qbar into `array`; returns how many of its rows are in use.
    pub fn advance(
        &mut self,
        model: &impl ImplicitModel,
        transition: &Transition<B::Scalar>,
    ) -> Result<usize, BadPivot> {
        let n = self.n;
        let mut u = self.u.view_mut();
        for j in n..u.columns() {
            let (x, theta) = u.column_mut(j).split_at_mut(n);
            advance(model, &transition.abar, x, &mut self.outputs);
            let blocks = (j - n) / n + 1;
            for (theta, &weight) in theta.chunks_exact(n).zip(&transition.phi).take(blocks) {
                axpy(weight, theta, x);
            }
        }
        for c in 0..n {
            let x = &mut self.work[..n];
            x.copy_from_slice(&u.column(c)[..n]);
            advance(model, &transition.abar, x, &mut self.outputs);
            for (i, &x) in x.iter().enumerate() {
                *self.array.at_mut(c, i) = x;
            }
            self.qbar.column_mut(c).copy_from_slice(transition.qbar.column(c));
        }
        let tolerance = 64.0 * n as f64 * B::Scalar::EPSILON;
        // Qbar is a moment too. Where w tells all of v and xi, nothing but rounding of either sign is left of it.
        let (qbar, root) = (self.qbar.view_mut(), self.root.view_mut());
        let rank = pivoted_cholesky(qbar, root, &mut self.work, tolerance, f64::INFINITY)?;
        for r in 0..rank {
            for i in 0..n {
                *self.array.at_mut(n + r, i) = self.root.at(i, r);
            }
        }
        Ok(n + rank)
    }

    /// U diag(d) U^T.
    pub fn dense(&self) -> Dense<B::Scalar> {
        let u = self.u.view();
        let size = u.rows();
        let mut p = Dense::<B::Scalar>::zeros(size, size);
        for k in 0..size {
            let column = u.column(k);
            for j in 0..=k {
                axpy(self.d[k] * column[j], &column[..=k], &mut p.column_mut(j)[..=k]);
            }
        }
        // Both triangles are the same sum in another order of factors; keep one.
        Dense::from_fn(size, size, |i, j| p.at(i.max(j), i.min(j)))
    }

    /// d, then the columns of U down to the diagonal.
    pub fn state(&self) -> Vec<B::Scalar> {
        let u = self.u.view();
        let columns = (0..u.columns()).flat_map(|j| u.column(j)[..=j].iter().copied());
        self.d.iter().copied().chain(columns).collect()
    }

    /// The inverse of `state`; false if the length is wrong.
    pub fn restore(&mut self, state: &[B::Scalar]) -> bool {
        let size = self.d.len();
        if state.len() != size + size * (size + 1) / 2 {
            return false;
        }
        let (d, mut rest) = state.split_at(size);
        self.d.copy_from_slice(d);
        for j in 0..size {
            let (column, tail) = rest.split_at(j + 1);
            self.u.view_mut().column_mut(j)[..=j].copy_from_slice(column);
            rest = tail;
        }
        true
    }

    /// One entry of f = U^T h, h the decorrelated row `k` over the outputs' states; `column` is U's down to the diagonal.
    #[inline]
    fn output_entry(rows: &Dense<B::Scalar>, k: usize, outputs: &[usize], column: &[B::Scalar]) -> B::Scalar {
        // T^-1 is lower triangular; below the diagonal U is zero.
        outputs[..=k].iter().enumerate().fold(B::Scalar::zero(), |sum, (i, &row)| match column.get(row) {
            Some(&u) => sum + rows.at(k, i) * u,
            None => sum,
        })
    }

    /// The first entry of d that is not a number from zero up.
    pub fn check(&self) -> Result<(), BadPivot> {
        match self.d.iter().position(|d| !(d.is_finite() && *d >= B::Scalar::zero())) {
            Some(index) => Err(BadPivot { index, value: self.d[index].to_f64() }),
            None => Ok(()),
        }
    }
}

/// Divides a gathered gain by the spread of its innovation, which must be positive.
fn unscale<S: Scalar>(index: usize, spread: S, gain: &mut [S]) -> Result<(), BadPivot> {
    if !(spread > S::zero() && spread.is_finite()) {
        return Err(BadPivot { index, value: spread.to_f64() });
    }
    gain.iter_mut().for_each(|x| *x /= spread);
    Ok(())
}
