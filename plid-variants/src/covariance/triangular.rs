//! P = U diag(d) U^T with U upper triangular: the common part of the factored forms.
//!
//! With s = [x; theta] and the parameters constant, U = [Ux, Uxt; 0, Ut]. A time update does not change Ut, and Uxt
//! becomes Abar Uxt + (phi (x) I) Ut.

use num_traits::{One, Zero};
use plid_core::kernels::{self, BadPivot, Kernels, PanelLayout, axpy};
use plid_core::{
    Backend, Dense, ImplicitModel, InitialCovariance, Matrix, NoiseTerms, Scalar, Transition, View, ViewMut,
};

use super::corner::{Advance, Corner, Laid};
use super::factor_initial;
use super::parameter_blocks::ParameterBlocks;

/// The factors and the scratch of their updates.
#[derive(Clone, Debug)]
pub struct Triangular<B: Backend> {
    /// The layout of U in `u`.
    pub layout: PanelLayout,
    /// U in panels.
    pub u: B::Matrix,
    /// d, N entries.
    pub d: Vec<B::Scalar>,
    /// A vector of N entries, with one column per panel.
    pub direction: Dense<B::Scalar>,
    // For the measurement update; k of p entries are in use if k outputs are available.
    /// H U of decorrelated measurements, p x N.
    rows: Dense<B::Scalar>,
    /// Two numbers for each measurement and column, 2p x N.
    changes: Dense<B::Scalar>,
    /// The gains multiplied by the spreads, with p columns per panel.
    gains: Dense<B::Scalar>,
    /// H times these gains.
    seen: Dense<B::Scalar>,
    /// T^-1 of R = T diag(r) T^T, p x p.
    decorrelation: Dense<B::Scalar>,
    spreads: Vec<B::Scalar>,
    innovation: Vec<B::Scalar>,
    // For the time update.
    advance: Advance<B::Scalar>,
    corner: Corner<B::Scalar>,
    outputs: Vec<B::Scalar>,
    blocks: ParameterBlocks<B::Scalar>,
}

type Recursion<S> = fn(ViewMut<'_, S>, &mut [S], &mut [S], ViewMut<'_, S>, ViewMut<'_, S>);

/// The kernels of a scalar measurement update.
#[derive(Clone, Copy, Debug)]
pub struct Updates<S> {
    /// Computes the spread of an innovation from its variance.
    pub spread: fn(S) -> S,
    /// A recursion such as [`Kernels::bierman_recursion`].
    pub recursion: Recursion<S>,
    /// A sweep such as [`Kernels::bierman_sweep`].
    pub sweep: fn(ViewMut<'_, S>, View<'_, S>, ViewMut<'_, S>),
}

impl<B: Backend> Triangular<B> {
    /// Factors P0.
    pub fn new(model: &dyn ImplicitModel, initial: &InitialCovariance) -> Result<Self, BadPivot> {
        let (p, size) = (model.outputs(), model.joint_states());
        let layout = PanelLayout::new(model.states(), model.parameter_columns() + 1);
        let (u0, d) = factor_initial::<B::Scalar>(initial)?;
        let mut u = B::Matrix::zeros(layout.rows(), layout.start(layout.count()));
        let n = layout.n();
        for k in 0..layout.count() {
            for j in k * n..size {
                let from = &u0.column(j)[k * n..(k + 1) * n];
                u.view_mut().column_mut(layout.column(k, j))[..n].copy_from_slice(from);
            }
        }
        let zero = B::Scalar::zero();
        let advance = Advance::new(model, layout);
        Ok(Self {
            layout,
            u,
            d,
            direction: Dense::zeros(layout.rows(), layout.count()),
            rows: Dense::zeros(p, size),
            changes: Dense::zeros(2 * p, size),
            gains: Dense::zeros(layout.rows(), p * layout.count()),
            seen: Dense::zeros(p, p),
            decorrelation: Dense::zeros(p, p),
            spreads: vec![zero; p],
            innovation: vec![zero; p],
            corner: Corner::new(&advance),
            advance,
            outputs: vec![zero; p],
            blocks: ParameterBlocks::new(layout),
        })
    }

    /// Returns entry (i, j) of U.
    pub fn at(&self, i: usize, j: usize) -> B::Scalar {
        let n = self.layout.n();
        if i > j { B::Scalar::zero() } else { self.u.view().at(i % n, self.layout.column(i / n, j)) }
    }

    /// Computes U diag(d) U^T H^T for rows of H that each select one state.
    pub fn output_columns(&self, rows: &[usize], out: ViewMut<'_, B::Scalar>) {
        B::Scalar::output_columns(self.layout, self.u.view(), &self.d, rows, out);
    }

    /// Adds the weighted sum of blocks of U diag(d) U^T between parameter columns to `out`.
    pub fn add_parameter_blocks(&mut self, weights: &Dense<B::Scalar>, out: ViewMut<'_, B::Scalar>) {
        let (layout, u) = (self.layout, self.u.view());
        let theta = u.block(0, layout.start(1), u.rows(), u.columns() - layout.start(1));
        self.blocks.add::<B>(weights, theta, &self.d[layout.n()..], out);
    }

    /// Decorrelates the available outputs with R = T diag(r) T^T: writes T^-1 to `decorrelation` and r to `spreads`.
    fn decorrelate(&mut self, noise: &NoiseTerms<B::Scalar>) {
        let count = noise.available().len();
        let rows = &mut self.decorrelation;
        for k in 0..count {
            for i in 0..count {
                *rows.at_mut(k, i) = if i == k { B::Scalar::one() } else { B::Scalar::zero() };
            }
            for l in 0..k {
                let factor = noise.sensor_unit(k, l);
                for i in 0..=l {
                    let known = rows.at(l, i);
                    *rows.at_mut(k, i) -= factor * known;
                }
            }
        }
        self.spreads[..count].copy_from_slice(noise.sensor_pivots());
    }

    /// Carries out the measurement update of all available outputs as a sequence of scalar updates.
    pub fn measure(
        &mut self,
        outputs: &[usize],
        noise: &NoiseTerms<B::Scalar>,
        innovation: &[B::Scalar],
        s: &mut [B::Scalar],
        updates: Updates<B::Scalar>,
    ) -> Result<(), BadPivot> {
        let count = outputs.len();
        self.decorrelate(noise);
        // H selects states, which are in the first panel; this panel begins with column 0 of U.
        let u = self.u.view();
        for j in 0..self.layout.size() {
            let (row, column) = (self.rows.column_mut(j), u.column(j));
            for k in 0..count {
                row[k] =
                    (0..k).fold(column[outputs[k]], |sum, i| sum + self.decorrelation.at(k, i) * column[outputs[i]]);
            }
        }
        for k in 0..count {
            self.innovation[k] = (0..k).fold(innovation[k], |sum, i| sum + self.decorrelation.at(k, i) * innovation[i]);
        }
        self.update(count, updates)?;
        for k in 0..count {
            let step = self.innovation[k] / self.spreads[k];
            let gains = self.gains.view();
            for (panel, s) in s.chunks_exact_mut(self.layout.n()).enumerate() {
                axpy(step, gains.column(panel * self.rows.rows() + k), s);
            }
            // This correction has already changed the innovations that follow.
            for l in k + 1..count {
                self.innovation[l] -= self.seen.at(l, k) * step;
            }
        }
        Ok(())
    }

    /// Carries out one scalar update with any row h; `r` is the variance of its noise.
    pub fn measure_row(
        &mut self,
        h: &[B::Scalar],
        r: B::Scalar,
        gain: &mut [B::Scalar],
        updates: Updates<B::Scalar>,
    ) -> Result<(), BadPivot> {
        let n = self.layout.n();
        for j in 0..h.len() {
            let parts = h.chunks_exact(n).enumerate().take(j / n + 1);
            *self.rows.at_mut(0, j) = parts.fold(B::Scalar::zero(), |sum, (k, h)| {
                sum + kernels::dot(h, self.u.view().column(self.layout.column(k, j)))
            });
        }
        self.spreads[0] = r;
        self.update(1, updates)?;
        for (panel, gain) in gain.chunks_exact_mut(n).enumerate() {
            let from = self.gains.column(panel * self.rows.rows());
            for (gain, &x) in gain.iter_mut().zip(from) {
                *gain = x / self.spreads[0];
            }
        }
        Ok(())
    }

    /// Applies the scalar updates to U. Their H U is in `rows`, and their noise variances are in `spreads`.
    fn update(&mut self, count: usize, updates: Updates<B::Scalar>) -> Result<(), BadPivot> {
        let (layout, size, all) = (self.layout, self.layout.size(), self.rows.rows());
        for spread in &mut self.spreads[..count] {
            *spread = (updates.spread)(*spread);
        }
        (updates.recursion)(
            self.rows.view_mut().block_mut(0, 0, count, size),
            &mut self.spreads[..count],
            &mut self.d,
            self.changes.view_mut().block_mut(0, 0, 2 * count, size),
            self.seen.view_mut().block_mut(0, 0, count, count),
        );
        if let Some(k) = self.spreads[..count].iter().position(|x| !(*x > B::Scalar::zero() && x.is_finite())) {
            return Err(BadPivot { index: k, value: self.spreads[k].to_f64() });
        }
        let changes = self.changes.view().block(0, 0, 2 * count, size);
        let sweep =
            |panels: std::ops::Range<usize>, mut u: ViewMut<'_, B::Scalar>, mut gains: ViewMut<'_, B::Scalar>| {
                for k in panels.clone() {
                    let (first, columns) = (k * layout.n(), size - k * layout.n());
                    (updates.sweep)(
                        u.block_mut(0, layout.start(k) - layout.start(panels.start), layout.rows(), columns),
                        changes.block(0, first, 2 * count, columns),
                        gains.block_mut(0, (k - panels.start) * all, layout.rows(), count),
                    );
                }
            };
        let half = layout.half();
        let (first, second) = self.u.view_mut().split_at_column(layout.start(half));
        let (first_gains, second_gains) = self.gains.view_mut().split_at_column(half * all);
        B::join(|| sweep(0..half, first, first_gains), || sweep(half..layout.count(), second, second_gains));
        Ok(())
    }

    /// Carries out the time update. `factor` replaces Ux (and its n entries of d) by the new factor of the filled
    /// array.
    pub fn time_update(
        &mut self,
        transition: &Transition<B::Scalar>,
        factor: impl FnOnce(&mut Corner<B::Scalar>, Laid, ViewMut<'_, B::Scalar>, &mut [B::Scalar]) + Send,
    ) -> Result<(), BadPivot> {
        let n = self.layout.n();
        self.advance.set(transition);
        let (ux, rest) = self.u.view_mut().split_at_column(n);
        let (uxt, theta) = rest.split_at_column(self.layout.start(1) - n);
        let (advance, corner, d, outputs) = (&self.advance, &mut self.corner, &mut self.d[..n], &mut self.outputs);
        // The two parts of the first panel's columns are independent of each other.
        let (result, ()) = B::join(
            || {
                let laid = corner.lay(advance, ux.view(), &transition.qbar)?;
                factor(corner, laid, ux, d);
                Ok(())
            },
            || advance.apply(theta.view(), &transition.phi, n, uxt, outputs),
        );
        result
    }

    /// Writes e_place times `value` into `direction`.
    pub fn point(&mut self, place: usize, value: B::Scalar) {
        let n = self.layout.n();
        self.direction.fill(B::Scalar::zero());
        *self.direction.at_mut(place % n, place / n) = value;
    }

    /// Returns U diag(d) U^T in scalar `T`.
    pub fn dense_in<T: Scalar>(&self) -> Dense<T> {
        let size = self.layout.size();
        let exactly = |x: B::Scalar| T::from_parts(x.to_parts());
        let mut p = Dense::<T>::zeros(size, size);
        let mut column = vec![T::zero(); size];
        for k in 0..size {
            for (i, x) in column.iter_mut().enumerate().take(k + 1) {
                *x = exactly(self.at(i, k));
            }
            for j in 0..=k {
                axpy(exactly(self.d[k]) * column[j], &column[j..=k], &mut p.column_mut(j)[j..=k]);
            }
        }
        Dense::from_fn(size, size, |i, j| p.at(i.max(j), i.min(j)))
    }

    /// Returns d, followed by the columns of U down to the diagonal.
    pub fn state(&self) -> Vec<B::Scalar> {
        let columns = (0..self.d.len()).flat_map(|j| (0..=j).map(move |i| self.at(i, j)));
        self.d.iter().copied().chain(columns).collect()
    }

    /// Restores the numbers that `state` returned; returns false if their length is wrong.
    pub fn restore(&mut self, state: &[B::Scalar]) -> bool {
        let (size, n) = (self.d.len(), self.layout.n());
        if state.len() != size + size * (size + 1) / 2 {
            return false;
        }
        let (d, rest) = state.split_at(size);
        self.d.copy_from_slice(d);
        let mut rest = rest.iter();
        for j in 0..size {
            for (i, &x) in (0..=j).zip(&mut rest) {
                *self.u.view_mut().at_mut(i % n, self.layout.column(i / n, j)) = x;
            }
        }
        true
    }

    /// Returns an error with the first entry of d that is negative or not finite.
    pub fn check(&self) -> Result<(), BadPivot> {
        match self.d.iter().position(|d| !(d.is_finite() && *d >= B::Scalar::zero())) {
            Some(index) => Err(BadPivot { index, value: self.d[index].to_f64() }),
            None => Ok(()),
        }
    }
}
