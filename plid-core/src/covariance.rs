//! The trait of the covariance forms, and the traits for operations beyond the two updates.

use crate::kernels::{BadPivot, Kernels, semidefinite_ldl};
use crate::{Dense, ImplicitModel, Matrix, NoiseTerms, Scalar, ViewMut};

/// The result that a conditional expectation passes to the time update: the covariance becomes
/// P <- Fbar P Fbar^T + diag(Qbar, 0) with Fbar = [Abar, phi (x) I; 0, I] and Abar = J + sum_i abar_i e_{c_i}^T, and
/// the mean becomes x <- J x + sum_k phi_k theta_k + d.
#[derive(Clone, Debug)]
pub struct Transition<S> {
    /// The columns abar_i, n x p.
    pub abar: Dense<S>,
    /// The regressor phi, p + m entries.
    pub phi: Vec<S>,
    /// The drift d, n entries.
    pub drift: Vec<S>,
    /// The lower triangle of Qbar (n x n).
    pub qbar: Dense<S>,
}

impl<S: Scalar> Transition<S> {
    /// Creates a transition of zeros in the sizes of `model`.
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
    /// The smallest pivot: an entry of D in a U D U^T form, a squared diagonal entry of S in an S S^T form, otherwise
    /// a pivot of the L D L^T factorisation of P.
    pub smallest_pivot: f64,
    /// The index of this pivot in s.
    pub index: usize,
    /// The largest |P_ij - P_ji| over sqrt(P_ii P_jj); zero by construction if one triangle or a factor is stored.
    pub symmetry_defect: f64,
    /// The ratio of the largest to the smallest pivot, a lower bound of the condition number; infinite if P is
    /// indefinite.
    pub condition: f64,
}

impl Health {
    /// Computes the numerical condition from a set of pivots and the given symmetry defect.
    pub fn from_pivots(pivots: impl Iterator<Item = f64>, symmetry_defect: f64) -> Self {
        let (mut smallest, mut index, mut largest) = (f64::INFINITY, 0, 0.0_f64);
        for (i, pivot) in pivots.enumerate() {
            // A NaN counts as smaller than any number.
            if pivot < smallest || pivot.is_nan() {
                (smallest, index) = (pivot, i);
            }
            largest = largest.max(pivot);
        }
        let condition = if smallest > 0.0 { largest / smallest } else { f64::INFINITY };
        Self { smallest_pivot: smallest, index, symmetry_defect, condition }
    }
}

/// The covariance of the initial estimate of s.
#[derive(Clone, Debug, PartialEq)]
pub enum InitialCovariance {
    /// Independent entries with these N variances.
    Diagonal(Vec<f64>),
    /// A full N x N covariance, for example from an earlier model.
    Full(Dense<f64>),
}

/// An operation that a covariance form does not offer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("this covariance form does not implement {0}")]
pub struct Unsupported(pub &'static str);

/// A form of the covariance P of s, with its two updates.
///
/// P belongs to s = [x; theta] in that order. The parameters are constant, so a triangular form need not change their
/// part in a time update. The updates must not allocate.
pub trait CovariancePropagation: Send + Sync + 'static {
    /// The number type.
    type Scalar: Kernels;

    /// The options of the form; `()` if there are none.
    type Options: Clone + Default
    where
        Self: Sized;

    /// Creates the initial covariance, for the sizes of `model`.
    ///
    /// # Errors
    /// Returns the pivot at which P0 is found not to be positive semidefinite.
    fn new(model: &dyn ImplicitModel, initial: &InitialCovariance, options: &Self::Options) -> Result<Self, BadPivot>
    where
        Self: Sized;

    /// Writes P H^T for the states in `rows`: one column of N entries for each.
    fn output_columns(&self, rows: &[usize], out: ViewMut<'_, Self::Scalar>);

    /// Adds the sum over s and t of weights(s, t) P_{theta_s theta_t} to the lower triangle of `out` (n x n).
    /// `weights` ((p + m) x (p + m)) is symmetric positive semidefinite.
    fn add_parameter_blocks(&mut self, weights: &Dense<Self::Scalar>, out: ViewMut<'_, Self::Scalar>);

    /// Performs the measurement update of P and of the estimate `s`: `z_i = s[rows[i]] + w_i`, `innovation` is
    /// z - H s, and `noise` holds R. All of them contain the available outputs only, in ascending order.
    ///
    /// # Errors
    /// Returns the pivot of the innovation covariance, or of P, that was not positive.
    fn measurement_update(
        &mut self,
        rows: &[usize],
        noise: &NoiseTerms<Self::Scalar>,
        innovation: &[Self::Scalar],
        s: &mut [Self::Scalar],
    ) -> Result<(), BadPivot>;

    /// Computes P <- Fbar P Fbar^T + diag(Qbar, 0).
    ///
    /// # Errors
    /// Returns the pivot of Qbar that is not finite, or the diagonal entry of P that is negative or not finite.
    fn time_update(&mut self, model: &dyn ImplicitModel, transition: &Transition<Self::Scalar>)
    -> Result<(), BadPivot>;

    /// Computes P <- `factor` P, for exponential forgetting. The recursion calls this method only if a run requires
    /// forgetting.
    ///
    /// # Errors
    /// Returns [`Unsupported`] if the form has no such operation, as in this default.
    fn scale(&mut self, _factor: Self::Scalar) -> Result<(), Unsupported> {
        Err(Unsupported("forgetting (`scale`)"))
    }

    /// Adds the parameter noise of one step, of variance `q`, to the variance of each parameter. A factored form may
    /// instead increase the variance of one parameter per step, in turn, by the noise accumulated over one round;
    /// `step` selects the parameter. The recursion calls this method only if a run requires parameter noise.
    ///
    /// # Errors
    /// Returns [`Unsupported`] if the form has no such operation, as in this default.
    fn add_parameter_noise(&mut self, _q: Self::Scalar, _step: u64) -> Result<(), Unsupported> {
        Err(Unsupported("parameter noise (`add_parameter_noise`)"))
    }
}

/// A form whose P can be inspected.
pub trait Inspect: CovariancePropagation {
    /// Returns P as a whole symmetric matrix in scalar `T`, formed from the stored numbers without rounding to the
    /// form's own scalar in between: `T::from_parts(x.to_parts())` for each entry.
    fn dense_in<T: Scalar>(&self) -> Dense<T>
    where
        Self: Sized;

    /// Returns P as a whole symmetric matrix.
    fn dense(&self) -> Dense<Self::Scalar>
    where
        Self: Sized,
    {
        self.dense_in()
    }

    /// Returns the numerical condition of P. The default factorises P; a form that propagates a factor uses this
    /// factor instead.
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

/// A form whose P can be stored and restored bit for bit.
pub trait Checkpointed: CovariancePropagation {
    /// Returns all numbers of the form's state.
    fn state(&self) -> Vec<Self::Scalar>;

    /// Restores the numbers of [`Checkpointed::state`]. Returns false, and changes nothing, if their count is wrong.
    fn restore(&mut self, state: &[Self::Scalar]) -> bool;
}

/// A form with a measurement update for an arbitrary row h. The recursion does not use this update, but textbook
/// problems of filter algebra do.
pub trait ScalarUpdate: CovariancePropagation {
    /// Performs the measurement update for one z = h s + w with an arbitrary row h (N entries) and variance `r`. The
    /// gain (N entries) is written to `gain`.
    ///
    /// # Errors
    /// Returns the innovation variance h P h^T + r if it is not positive.
    fn scalar_update(&mut self, h: &[Self::Scalar], r: Self::Scalar, gain: &mut [Self::Scalar])
    -> Result<(), BadPivot>;
}

/// The scalar of a covariance form.
pub type ScalarOf<C> = <C as CovariancePropagation>::Scalar;
