//! The trait of the covariance forms, and the traits for operations beyond the two updates.

use crate::kernels::{BadPivot, Kernels, semidefinite_ldl};
use crate::{Dense, ImplicitModel, Matrix, NoiseTerms, Scalar, ViewMut};

/// The result that a conditional expectation passes to the time update:
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
    pub fn new(model: &dyn ImplicitModel) -> Self {
        let n = model.states();
        Self {
            abar: Dense::zeros(n, model.outputs()),
            phi: vec![S::zero(); model.parameter_columns()],
            drift: vec![S::zero(); n],
            qbar: Dense::zeros(n, n),
        }
    }
}

/// The numerical condition of P at the end of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Health {
    /// The smallest pivot: of D in a U D U^T or S S^T form, else of a Cholesky factorisation of P.
    pub smallest_pivot: f64,
    /// Its place in s.
    pub index: usize,
    /// The largest |P_ij - P_ji| over sqrt(P_ii P_jj); zero by construction where one triangle or a factor is stored.
    pub symmetry_defect: f64,
    /// The ratio of the largest to the smallest pivot, a lower bound of the condition number; infinite if P is
    /// indefinite.
    pub condition: f64,
}

impl Health {
    /// The numerical condition that follows from a set of pivots, with the given symmetry defect.
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
    /// A full N x N covariance, for example from an earlier model.
    Full(Dense<f64>),
}

/// An operation that a covariance form does not offer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("this covariance form does not implement {0}")]
pub struct Unsupported(pub &'static str);

/// A form of the covariance P of s and its two updates.
///
/// P belongs to s = [x; theta] in that order. The parameters are constant, so a triangular form need not touch their
/// part in a time update. The updates must not allocate.
pub trait CovariancePropagation: Send + Sync + 'static {
    /// The number type.
    type Scalar: Kernels;

    /// The options of the form; `()` if there are none.
    type Options: Clone + Default
    where
        Self: Sized;

    /// The first covariance, for the shapes of `model`.
    ///
    /// # Errors
    /// The pivot at which P0 is found not to be positive semidefinite.
    fn new(model: &dyn ImplicitModel, initial: &InitialCovariance, options: &Self::Options) -> Result<Self, BadPivot>
    where
        Self: Sized;

    /// Writes P H^T for the states in `rows`, one column of N entries each.
    fn output_columns(&self, rows: &[usize], out: ViewMut<'_, Self::Scalar>);

    /// `out` += the sum over s, t of weights(s, t) P_{theta_s theta_t}, lower triangle, n x n. `weights`, (p + m) x
    /// (p + m), is symmetric positive semidefinite.
    fn add_parameter_blocks(&mut self, weights: &Dense<Self::Scalar>, out: ViewMut<'_, Self::Scalar>);

    /// The measurement update of P and of the estimate `s`: `z_i = s[rows[i]] + w_i`, `innovation` is z - H s, and
    /// `noise` holds R. The outputs are those that are available, in that order.
    ///
    /// # Errors
    /// The pivot of the innovation covariance, or of P, that was not positive.
    fn measurement_update(
        &mut self,
        rows: &[usize],
        noise: &NoiseTerms<Self::Scalar>,
        innovation: &[Self::Scalar],
        s: &mut [Self::Scalar],
    ) -> Result<(), BadPivot>;

    /// P <- Fbar P Fbar^T + diag(Qbar, 0).
    ///
    /// # Errors
    /// The pivot of Qbar that is not finite, or the diagonal entry of P that is negative or not finite.
    fn time_update(&mut self, model: &dyn ImplicitModel, transition: &Transition<Self::Scalar>)
    -> Result<(), BadPivot>;

    /// P <- `factor` P, for exponential forgetting. The loop calls it only where a run asks for forgetting.
    ///
    /// # Errors
    /// [`Unsupported`] if the form has no such operation, as here.
    fn scale(&mut self, _factor: Self::Scalar) -> Result<(), Unsupported> {
        Err(Unsupported("forgetting (`scale`)"))
    }

    /// Adds parameter noise of variance `q` a step to the variance of each parameter. A factored form may inflate one
    /// parameter a step, in turn, by the noise accumulated over one round; `step` selects the parameter. The loop calls
    /// it only where a run asks for parameter noise.
    ///
    /// # Errors
    /// [`Unsupported`] if the form has no such operation, as here.
    fn add_parameter_noise(&mut self, _q: Self::Scalar, _step: u64) -> Result<(), Unsupported> {
        Err(Unsupported("parameter noise (`add_parameter_noise`)"))
    }
}

/// A form whose P can be inspected.
pub trait Inspect: CovariancePropagation {
    /// P as a whole symmetric matrix in scalar `T`, formed from the stored numbers without rounding to the form's own
    /// scalar in between: `T::from_parts(x.to_parts())` for each entry.
    fn dense_in<T: Scalar>(&self) -> Dense<T>
    where
        Self: Sized;

    /// P as a whole symmetric matrix.
    fn dense(&self) -> Dense<Self::Scalar>
    where
        Self: Sized,
    {
        self.dense_in()
    }

    /// The numerical condition of P. By default P is factorised; a form that carries a factor uses that instead.
    fn health(&self) -> Health
    where
        Self: Sized,
    {
        let mut p = self.dense();
        let mut pivots = vec![num_traits::Zero::zero(); p.rows()];
        match semidefinite_ldl(p.view_mut(), &mut pivots, 0.0, 0.0) {
            Ok(()) => Health::from_pivots(pivots.iter().map(|d: &Self::Scalar| d.to_f64()), 0.0),
            Err(BadPivot { index, value }) => {
                Health { smallest_pivot: value, index, symmetry_defect: 0.0, condition: f64::INFINITY }
            }
        }
    }
}

/// A form whose P can be stored and restored with the same bits.
pub trait Checkpointed: CovariancePropagation {
    /// All numbers of the form's state.
    fn state(&self) -> Vec<Self::Scalar>;

    /// Restores the numbers of [`Checkpointed::state`]. Returns false, and changes nothing, if their count is wrong.
    fn restore(&mut self, state: &[Self::Scalar]) -> bool;
}

/// A form with a measurement update for any row h. The loop does not use it, but textbook problems of filter algebra
/// do.
pub trait ScalarUpdate: CovariancePropagation {
    /// The measurement update of one z = h s + w with any row h (N entries) and variance `r`; the gain (N entries) is
    /// written to `gain`.
    ///
    /// # Errors
    /// An innovation variance h P h^T + r that is not positive.
    fn scalar_update(&mut self, h: &[Self::Scalar], r: Self::Scalar, gain: &mut [Self::Scalar])
    -> Result<(), BadPivot>;
}

/// The scalar of a covariance form.
pub type ScalarOf<C> = <C as CovariancePropagation>::Scalar;
