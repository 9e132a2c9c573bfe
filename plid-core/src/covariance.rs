//! The trait of the covariance forms: who owns P, and in which form.

use crate::kernels::BadPivot;
use crate::{Backend, Dense, ImplicitModel, NoiseTerms, Scalar, ViewMut};

/// What a conditional expectation hands to the time update (plid-mathematics, section 4):
/// P <- Fbar P Fbar^T + diag(Qbar, 0) with Fbar = [Abar, phi (x) I; 0, I], Abar = J + sum_i abar_i e_{c_i}^T, and
/// the mean x <- J x + sum_k phi_k theta_k + d.
#[derive(Clone, Debug)]
pub struct Transition<S> {
    /// The columns abar_i, n x p.
    pub abar: Dense<S>,
    /// The regressor phi, p + m entries.
    pub phi: Vec<S>,
    /// The drift d, n entries.
    pub drift: Vec<S>,
    /// Qbar, n x n, the lower triangle.
    pub qbar: Dense<S>,
}

impl<S: Scalar> Transition<S> {
    /// Zeros, of the shapes of `model`.
    pub fn new(model: &impl ImplicitModel) -> Self {
        use crate::Matrix;
        let n = model.states();
        Self {
            abar: Dense::zeros(n, model.outputs()),
            phi: vec![S::zero(); model.parameter_columns()],
            drift: vec![S::zero(); n],
            qbar: Dense::zeros(n, n),
        }
    }
}

/// How sound P is, at the end of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Health {
    /// The smallest pivot: of D in a U D U^T or S S^T form, else of a Cholesky factorisation of P.
    pub smallest_pivot: f64,
    /// Its place in s.
    pub index: usize,
    /// The largest |P_ij - P_ji| over sqrt(P_ii P_jj); zero by construction where one triangle or a factor is stored.
    pub symmetry_defect: f64,
    /// The ratio of the largest to the smallest pivot, a lower bound of the condition number; infinite if P is indefinite.
    pub condition: f64,
}

impl Health {
    /// The health that a set of pivots tells, with the stated symmetry defect.
    pub fn from_pivots(pivots: impl Iterator<Item = f64>, symmetry_defect: f64) -> Self {
        let (mut smallest, mut index, mut largest) = (f64::INFINITY, 0, 0.0_f64);
        for (i, pivot) in pivots.enumerate() {
            // NaN is worse than any number.
            if pivot < smallest || pivot.is_nan() {
                (smallest, index) = (pivot, i);
            }
            largest = largest.max(pivot);
        }
        let condition = if smallest > 0.0 { largest / smallest } else { f64::INFINITY };
        Self { smallest_pivot: smallest, index, symmetry_defect, condition }
    }
}

/// The covariance of the first estimate of s.
#[derive(Clone, Debug, PartialEq)]
pub enum InitialCovariance {
    /// Independent entries with these variances, N of them.
    Diagonal(Vec<f64>),
    /// A whole N x N covariance, from a former model for example.
    Full(Dense<f64>),
}

/// A form of the covariance P of s and its two updates.
///
/// P is kept for s = [x; theta] in that order: the parameters are constant, so that a form which stays triangular
/// need not touch their part in a time update. No method but the constructors, `dense` and `health` may allocate.
pub trait CovariancePropagation: Clone + Send + Sync + Sized + 'static {
    /// The matrix library and with it the scalar.
    type Backend: Backend;

    /// The first covariance, for the shapes of `model`.
    ///
    /// # Errors
    /// The pivot at which a P0 turned out not to be positive semidefinite.
    fn new(model: &impl ImplicitModel, initial: &InitialCovariance) -> Result<Self, BadPivot>;

    /// P H^T of the states in `rows`, one N-column each.
    fn output_columns(&self, rows: &[usize], out: ViewMut<'_, ScalarOf<Self>>);

    /// `out` += the sum over s, t of weights(s, t) P_{theta_s theta_t}, lower triangle, n x n. `weights`, (p + m) x (p + m), is
    /// symmetric positive semidefinite.
    fn add_parameter_blocks(&mut self, weights: &Dense<ScalarOf<Self>>, out: ViewMut<'_, ScalarOf<Self>>);

    /// The measurement update of P, and of the estimate `s`: `z_i = s[rows[i]] + w_i`, `innovation` is z - H s and `noise` holds R.
    ///
    /// # Errors
    /// The pivot of the innovation covariance, or of P, that was not positive.
    fn measurement_update(
        &mut self,
        rows: &[usize],
        noise: &NoiseTerms<ScalarOf<Self>>,
        innovation: &[ScalarOf<Self>],
        s: &mut [ScalarOf<Self>],
    ) -> Result<(), BadPivot>;

    /// The measurement update of one z = h s + w with any row h (N entries) and variance `r`; the gain (N entries) is written to `gain`.
    ///
    /// # Errors
    /// An innovation variance h P h^T + r that is not positive.
    fn scalar_update(
        &mut self,
        h: &[ScalarOf<Self>],
        r: ScalarOf<Self>,
        gain: &mut [ScalarOf<Self>],
    ) -> Result<(), BadPivot>;

    /// P <- Fbar P Fbar^T + diag(Qbar, 0).
    ///
    /// # Errors
    /// The pivot of Qbar that is not finite, or the diagonal entry of P that is negative or not finite.
    fn time_update(
        &mut self,
        model: &impl ImplicitModel,
        transition: &Transition<ScalarOf<Self>>,
    ) -> Result<(), BadPivot>;

    /// Adds parameter noise of variance `q` a step to each parameter's variance. A factored form inflates one parameter a
    /// step, in turn, by as much as it gathers in a round; `step` says whose turn it is.
    fn add_parameter_noise(&mut self, q: ScalarOf<Self>, step: u64);

    /// P <- `factor` P.
    fn scale(&mut self, factor: ScalarOf<Self>);

    /// P as a whole symmetric matrix.
    fn dense(&self) -> Dense<ScalarOf<Self>>;

    /// How sound P is.
    fn health(&self) -> Health;

    /// The numbers that the form consists of: what a checkpoint stores.
    fn state(&self) -> Vec<ScalarOf<Self>>;

    /// Takes the numbers of [`CovariancePropagation::state`] back; false, and nothing is changed, if there are too few or too many.
    fn restore(&mut self, state: &[ScalarOf<Self>]) -> bool;
}

/// The scalar of a covariance form.
pub type ScalarOf<C> = <<C as CovariancePropagation>::Backend as Backend>::Scalar;
