//! P as a matrix, of which the lower triangle is stored. The time update is shared; the measurement update is given
//! by a rule.

use std::marker::PhantomData;

use num_traits::{One, Zero};
use plid_core::kernels::{BadPivot, Kernels, Shift, axpy, cholesky, dot};
use plid_core::{
    Backend, Checkpointed, CovariancePropagation, Dense, Form, FormFacts, ImplicitModel, InitialCovariance, Inspect,
    Matrix, NoiseTerms, Scalar, ScalarUpdate, StepSize, Term, Transition, Unsupported, View, ViewMut,
};

use super::factor_initial;

/// The inputs of a correction of P by k outputs.
#[derive(Clone, Copy, Debug)]
pub struct Innovations<'a, S> {
    /// P H^T with P after the preceding corrections, N x k.
    pub cross: View<'a, S>,
    /// The gain K = P H^T Re^-1, N x k.
    pub gain: View<'a, S>,
    /// R, k x k.
    pub sensor: View<'a, S>,
    /// The lower Cholesky factor of Re = H P H^T + R, k x k.
    pub factor: View<'a, S>,
}

/// The formula for P+.
pub trait UpdateRule: Clone + Send + Sync + 'static {
    /// Number of corrections in sequence.
    const CORRECTIONS: usize;

    /// Computes `left` and `right` (N x k) of correction `which`, which is P <- P - left right^T.
    fn correction<S: Scalar>(
        which: usize,
        innovations: Innovations<'_, S>,
        left: ViewMut<'_, S>,
        right: ViewMut<'_, S>,
    );
}

/// P as a symmetric matrix with the measurement update `R`.
#[derive(Clone, Debug)]
pub struct Symmetric<B: Backend, R> {
    /// The lower triangle of P, N x N. The upper triangle is zero, on which the block product relies.
    p: B::Matrix,
    n: usize,
    rule: PhantomData<R>,
    // Scratch.
    cross: B::Matrix,
    gain: B::Matrix,
    left: B::Matrix,
    right: B::Matrix,
    output: Dense<B::Scalar>,
    sensor: Dense<B::Scalar>,
    factor: Dense<B::Scalar>,
    sums: Dense<B::Scalar>,
    product: Dense<B::Scalar>,
    mirrored: Dense<B::Scalar>,
    work: Vec<B::Scalar>,
    /// J.
    shift: Shift,
}

/// Number of columns of the product with the regressor that are formed at once. It is small enough for their scratch
/// to stay in the nearest cache, and large enough for the work to be divided among threads.
const COLUMNS_AT_ONCE: usize = 32;

/// Writes column `c` of the symmetric matrix whose lower triangle is `p` to `out`.
fn symmetric_column<S: Scalar>(p: View<'_, S>, c: usize, out: &mut [S]) {
    for (i, x) in out.iter_mut().enumerate().take(c) {
        *x = p.at(c, i);
    }
    out[c..].copy_from_slice(&p.column(c)[c..]);
}

impl<B: Backend, R: UpdateRule> Symmetric<B, R> {
    /// Computes the gain and corrects P. `observe` writes P H^T into the first `k` columns of its second argument;
    /// `output` and `sensor` hold H P H^T and R.
    fn correct(
        &mut self,
        k: usize,
        observe: impl Fn(View<'_, B::Scalar>, ViewMut<'_, B::Scalar>),
    ) -> Result<(), BadPivot> {
        let size = self.p.view().rows();
        for j in 0..k {
            for i in 0..k {
                *self.factor.at_mut(i, j) = self.output.at(i, j) + self.sensor.at(i, j);
            }
        }
        let mut factor = self.factor.view_mut();
        let mut factor = factor.block_mut(0, 0, k, k);
        cholesky(factor.reborrow())?;
        let factor = factor.view();
        let mut gain = self.gain.view_mut();
        let mut gain = gain.block_mut(0, 0, size, k);
        B::Scalar::solve_gain(self.cross.view().block(0, 0, size, k), factor.block(0, 0, k, k), gain.reborrow());
        for which in 0..R::CORRECTIONS {
            if which > 0 {
                observe(self.p.view(), self.cross.view_mut());
            }
            let innovations = Innovations {
                cross: self.cross.view().block(0, 0, size, k),
                gain: gain.view(),
                sensor: self.sensor.view().block(0, 0, k, k),
                factor,
            };
            R::correction(which, innovations, self.left.view_mut(), self.right.view_mut());
            let left = self.left.view().block(0, 0, size, k);
            let right = self.right.view().block(0, 0, size, k);
            B::symmetric_product_lower(self.p.view_mut(), -B::Scalar::one(), left, right);
        }
        // Rounding may make a variance negative if the outputs determine a state exactly. If it is more negative than
        // that, P is lost.
        let tolerance = B::Scalar::from_f64(64.0 * B::Scalar::EPSILON);
        for i in 0..size {
            let variance = self.p.view().at(i, i);
            if variance >= B::Scalar::zero() {
                continue;
            }
            // (K Re K^T)_ii
            let taken = (0..k).fold(B::Scalar::zero(), |taken, c| {
                let root = (c..k).fold(B::Scalar::zero(), |sum, r| sum + factor.at(r, c) * gain.at(i, r));
                taken + root * root
            });
            if !(variance >= -tolerance * taken) {
                return Err(BadPivot { index: i, value: variance.to_f64() });
            }
        }
        Ok(())
    }
}

impl<B: Backend, R: UpdateRule> CovariancePropagation for Symmetric<B, R> {
    type Scalar = B::Scalar;
    type Options = ();

    fn new(model: &dyn ImplicitModel, initial: &InitialCovariance, _: &()) -> Result<Self, BadPivot> {
        factor_initial::<B::Scalar>(initial)?;
        let (n, outputs, size) = (model.states(), model.outputs(), model.joint_states());
        let mut p = B::Matrix::zeros(size, size);
        for j in 0..size {
            match initial {
                InitialCovariance::Diagonal(d) => *p.view_mut().at_mut(j, j) = B::Scalar::from_f64(d[j]),
                InitialCovariance::Full(p0) => {
                    for (to, &from) in p.view_mut().column_mut(j)[j..].iter_mut().zip(&p0.column(j)[j..]) {
                        *to = B::Scalar::from_f64(from);
                    }
                }
            }
        }
        Ok(Self {
            p,
            n,
            rule: PhantomData,
            cross: B::Matrix::zeros(size, outputs),
            gain: B::Matrix::zeros(size, outputs),
            left: B::Matrix::zeros(size, outputs),
            right: B::Matrix::zeros(size, outputs),
            output: Dense::zeros(outputs, outputs),
            sensor: Dense::zeros(outputs, outputs),
            factor: Dense::zeros(outputs, outputs),
            sums: Dense::zeros(n, n),
            product: Dense::zeros(n, n),
            mirrored: Dense::zeros(n, COLUMNS_AT_ONCE.min(n) * model.parameter_columns()),
            work: vec![B::Scalar::zero(); outputs],
            shift: Shift::new(model),
        })
    }

    fn output_columns(&self, rows: &[usize], mut out: ViewMut<'_, B::Scalar>) {
        for (k, &row) in rows.iter().enumerate() {
            symmetric_column(self.p.view(), row, out.column_mut(k));
        }
    }

    fn add_parameter_blocks(&mut self, weights: &Dense<B::Scalar>, mut out: ViewMut<'_, B::Scalar>) {
        let (n, size) = (self.n, self.p.view().rows());
        let theta = self.p.view().block(n, n, size - n, size - n);
        B::Scalar::add_weighted_blocks_lower(theta, weights.view(), out.reborrow(), self.sums.view_mut());
    }

    fn measurement_update(
        &mut self,
        rows: &[usize],
        noise: &NoiseTerms<B::Scalar>,
        innovation: &[B::Scalar],
        s: &mut [B::Scalar],
    ) -> Result<(), BadPivot> {
        let k = rows.len();
        if k == 0 {
            return Ok(());
        }
        let observe = |p: View<'_, B::Scalar>, mut cross: ViewMut<'_, B::Scalar>| {
            for (j, &row) in rows.iter().enumerate() {
                symmetric_column(p, row, cross.column_mut(j));
            }
        };
        observe(self.p.view(), self.cross.view_mut());
        for j in 0..k {
            for (i, &row) in rows.iter().enumerate() {
                *self.output.at_mut(i, j) = self.cross.view().at(row, j);
                *self.sensor.at_mut(i, j) = noise.sensor(i, j);
            }
        }
        self.correct(k, observe)?;
        for (j, &e) in innovation.iter().enumerate() {
            axpy(e, self.gain.view().column(j), s);
        }
        Ok(())
    }

    fn time_update(&mut self, model: &dyn ImplicitModel, transition: &Transition<B::Scalar>) -> Result<(), BadPivot> {
        let (n, size) = (self.n, self.p.view().rows());
        let Transition { abar, phi, qbar, .. } = transition;
        let (abar, rows) = (abar.view(), model.output_states());
        let outputs = &mut self.work[..rows.len()];
        // W = P_xx Abar^T + ((phi (x) I) P_{theta x})^T. First, both triangles of P_xx are formed, with the diagonal
        // only once.
        for c in 0..n {
            let column = &self.p.view().column(c)[..n];
            self.product.column_mut(c).copy_from_slice(column);
            self.sums.column_mut(c).copy_from_slice(column);
            *self.sums.at_mut(c, c) = B::Scalar::zero();
        }
        B::Scalar::add_mirrored(self.sums.view(), 1, 0, 0, self.product.view_mut());
        let mut kept = self.cross.view_mut();
        let kept_states = kept.block_mut(0, 0, n, rows.len());
        B::Scalar::advance_rows(self.product.view_mut(), &self.shift, rows, abar, kept_states);
        self.sums.fill(B::Scalar::zero());
        B::Scalar::add_block_sums(self.sums.view_mut(), self.p.view().block(n, 0, size - n, n), phi);
        B::Scalar::add_mirrored(self.sums.view(), 1, 0, 0, self.product.view_mut());
        // P_{theta x} <- P_{theta x} Abar^T + P_{theta theta} (phi (x) I)^T
        let mut p = self.p.view_mut();
        let (mut left, mut right) = p.reborrow().split_at_column(n);
        let mut cross = left.block_mut(n, 0, size - n, n);
        let kept = kept.block_mut(n, 0, size - n, rows.len());
        B::Scalar::advance_rows(cross.reborrow(), &self.shift, rows, abar, kept);
        let theta = right.block_mut(n, 0, size - n, size - n);
        B::block_product_lower(theta.view(), phi, cross, self.mirrored.view_mut());
        // P_xx <- Abar W + (phi (x) I) P_{theta x} + Qbar, of which the lower triangle is stored in P.
        B::Scalar::advance_columns(self.product.view_mut(), &self.shift, rows, abar, outputs);
        B::Scalar::add_block_sums(self.product.view_mut(), left.view().block(n, 0, size - n, n), phi);
        for i in 0..n {
            let x = &mut left.column_mut(i)[i..n];
            for ((x, &product), &noise) in x.iter_mut().zip(&self.product.column(i)[i..]).zip(&qbar.column(i)[i..]) {
                *x = product + noise;
            }
            let variance = x[0];
            if !(variance >= B::Scalar::zero()) {
                return Err(BadPivot { index: i, value: variance.to_f64() });
            }
        }
        Ok(())
    }

    fn scale(&mut self, factor: B::Scalar) -> Result<(), Unsupported> {
        let mut p = self.p.view_mut();
        for j in 0..p.columns() {
            p.column_mut(j)[j..].iter_mut().for_each(|x| *x *= factor);
        }
        Ok(())
    }

    fn add_parameter_noise(&mut self, q: B::Scalar, _step: u64) -> Result<(), Unsupported> {
        let mut p = self.p.view_mut();
        for i in self.n..p.rows() {
            *p.at_mut(i, i) += q;
        }
        Ok(())
    }
}

impl<B: Backend, R: UpdateRule> Inspect for Symmetric<B, R> {
    fn dense_in<T: Scalar>(&self) -> Dense<T> {
        let p = self.p.view();
        Dense::from_fn(p.rows(), p.rows(), |i, j| T::from_parts(p.at(i.max(j), i.min(j)).to_parts()))
    }
}

impl<B: Backend, R: UpdateRule> Checkpointed for Symmetric<B, R> {
    fn state(&self) -> Vec<B::Scalar> {
        let p = self.p.view();
        (0..p.columns()).flat_map(|j| p.column(j)[j..].iter().copied()).collect()
    }

    fn restore(&mut self, state: &[B::Scalar]) -> bool {
        let mut p = self.p.view_mut();
        let size = p.rows();
        if state.len() != size * (size + 1) / 2 {
            return false;
        }
        let mut rest = state;
        for j in 0..size {
            let (column, tail) = rest.split_at(size - j);
            p.column_mut(j)[j..].copy_from_slice(column);
            rest = tail;
        }
        true
    }
}

impl<B: Backend, R: UpdateRule> ScalarUpdate for Symmetric<B, R> {
    fn scalar_update(&mut self, h: &[B::Scalar], r: B::Scalar, gain: &mut [B::Scalar]) -> Result<(), BadPivot> {
        let observe = |p: View<'_, B::Scalar>, mut cross: ViewMut<'_, B::Scalar>| {
            let cross = cross.column_mut(0);
            cross.fill(B::Scalar::zero());
            for j in 0..h.len() {
                let column = &p.column(j)[j..];
                cross[j] += dot(column, &h[j..]);
                axpy(h[j], &column[1..], &mut cross[j + 1..]);
            }
        };
        observe(self.p.view(), self.cross.view_mut());
        *self.output.at_mut(0, 0) = dot(h, self.cross.view().column(0));
        *self.sensor.at_mut(0, 0) = r;
        self.correct(1, observe)?;
        gain.copy_from_slice(self.gain.view().column(0));
        Ok(())
    }
}

impl<B: Backend, R: UpdateRule> Form for Symmetric<B, R> {
    const FACTS: FormFacts = FormFacts {
        factored: false,
        updates: |size| update_flops(size, R::CORRECTIONS as f64),
        parameter_blocks: block_flops,
        output_columns: |_| Vec::new(),
    };
}

/// Returns the operations of the updates. Each of the `corrections` of the measurement update subtracts a product of
/// rank p from P.
fn update_flops(size: &StepSize, corrections: f64) -> Vec<Term> {
    let (n, p, c, joint) = (size.n, size.p, size.columns(), size.joint());
    vec![
        // K = P H^T (L L^T)^-1 takes two triangular solves of p^2 operations for each of N rows.
        Term { what: "gain", flops: 2.0 * joint * p * p },
        // A product and a sum for every entry of the triangle and each of p columns, and the computation of the
        // factor.
        Term {
            what: "measurement update of P",
            flops: corrections * (2.0 * p * size.triangle() + joint * p * (p + 1.0)),
        },
        // (K Re K^T)_ii for each of N variances.
        Term { what: "check of the variances", flops: joint * p * (p + 3.0) },
        // Abar P_xx Abar^T takes p products for each of n^2 entries, and one with the entry of J, which is one or
        // zero, from each side; P_{theta x} takes the same from one side.
        Term { what: "Abar on the states' rows", flops: 2.0 * (p + 1.0) * (c + 2.0) * n * n },
        // (phi (x) I) P_{theta x}, twice: 2 c for each of n^2 entries.
        Term { what: "phi on P_{theta x}", flops: 4.0 * c * n * n },
        // P_{theta theta} (phi (x) I)^T: each entry of the lower triangle is used for itself and for its mirror
        // image, and the two sums are then added.
        Term { what: "phi on P_{theta theta}", flops: 2.0 * c * c * n * n + c * n * n },
    ]
}

/// Returns the operations of the sums of blocks. A symmetric block on the diagonal has n (n + 1) / 2 entries that
/// count. A block off the diagonal has n^2, and the sum of these blocks is added to its transpose.
fn block_flops(size: &StepSize, pairs: f64) -> Vec<Term> {
    let (n, c) = (size.n, size.columns());
    let mirrored = if pairs > 0.0 { n * n } else { 0.0 };
    vec![Term { what: "sum of the parameters' blocks", flops: (c + 2.0 * pairs) * n * n + mirrored }]
}
