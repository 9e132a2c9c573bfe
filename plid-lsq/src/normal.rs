//! Normal equations as one dense matrix.

use nalgebra::{Cholesky, DMatrix, DMatrixView, DVector, DVectorView};

use crate::problem::Equations;

/// Factor on the scale of the damping from one linearisation to the next; see [`Normal::memory`].
const MEMORY: f64 = 0.5;

/// The matrix J'J and the vector J'r, to which a record may be added block by block.
///
/// The damping is relative to the diagonal of J'J (Marquardt). With a [`memory`](Self::memory), the scale of a
/// parameter falls slowly where its influence on the model vanishes. Without a memory, the damping vanishes as well,
/// and one long step may end on a plateau. Moré (*Numerical Analysis*, Lecture Notes in Mathematics 630, 1978, 105)
/// never lets the scale fall, which makes the search slow if it starts in units far from those of the solution.
#[derive(Clone, Debug)]
pub struct Normal {
    /// J'J, to which a prior adds its precision.
    pub matrix: DMatrix<f64>,
    /// J'r, to which a prior adds its pull.
    pub right: DVector<f64>,
    /// Smallest factor by which the scale of a parameter changes between linearisations. Zero is Marquardt's rule, and
    /// one is Moré's.
    pub memory: f64,
    /// Lower limit of each parameter's scale.
    scale: DVector<f64>,
}

impl Normal {
    /// Returns equations without data and with a memory of a half.
    pub fn new(parameters: usize) -> Self {
        Self {
            matrix: DMatrix::zeros(parameters, parameters),
            right: DVector::zeros(parameters),
            memory: MEMORY,
            scale: DVector::zeros(parameters),
        }
    }

    /// Returns equations without data and without memory: the scale is that of the present point alone (Marquardt).
    pub fn without_memory(parameters: usize) -> Self {
        Self { memory: 0.0, ..Self::new(parameters) }
    }

    /// Removes all data, so that another point can be linearised.
    pub fn clear(&mut self) {
        for i in 0..self.right.len() {
            self.scale[i] = self.memory * self.scale[i].max(self.matrix[(i, i)]);
        }
        self.matrix.fill(0.0);
        self.right.fill(0.0);
    }

    /// Adds data: the Jacobian of the model (rows x parameters) and the residual.
    pub fn add(&mut self, jacobian: DMatrixView<'_, f64>, residual: DVectorView<'_, f64>) {
        // The library multiplies in blocks only if no factor is given as a transpose.
        self.matrix.gemm(1.0, &jacobian.transpose(), &jacobian, 1.0);
        self.right.gemv_tr(1.0, &jacobian, &residual, 1.0);
    }

    /// Adds a Gaussian prior on a parameter whose value lies `offset` above the prior's mean.
    pub fn add_prior(&mut self, parameter: usize, offset: f64, variance: f64) {
        self.matrix[(parameter, parameter)] += 1.0 / variance;
        self.right[parameter] -= offset / variance;
    }

    /// Solves for a step, with a separate damping for each parameter. Returns whether there is a finite solution.
    pub fn solve_damped(
        &self,
        damping: impl Fn(usize) -> f64,
        work: &mut DMatrix<f64>,
        step: &mut DVector<f64>,
    ) -> bool {
        let mut damped = std::mem::take(work);
        if damped.shape() != self.matrix.shape() {
            damped = self.matrix.clone();
        } else {
            damped.copy_from(&self.matrix);
        }
        for i in 0..self.right.len() {
            // A parameter without any influence stays where it is.
            damped[(i, i)] += damping(i) * self.scale[i].max(self.matrix[(i, i)]) + f64::MIN_POSITIVE;
        }
        let Some(factor) = Cholesky::new(damped) else { return false };
        if step.len() == self.right.len() {
            step.copy_from(&self.right);
        } else {
            *step = self.right.clone();
        }
        factor.solve_mut(step);
        *work = factor.unpack_dirty();
        step.iter().all(|x| x.is_finite())
    }

    /// Returns the inverse of the matrix, which is the covariance of the parameters if the residual is white with
    /// variance 1. `None` if the matrix is singular.
    pub fn covariance(&self) -> Option<DMatrix<f64>> {
        let size = self.matrix.map_diagonal(|x| if x > 0.0 { 1.0 / x.sqrt() } else { 1.0 });
        let scaled = |h: &DMatrix<f64>| DMatrix::from_fn(h.nrows(), h.ncols(), |i, j| h[(i, j)] * size[i] * size[j]);
        Some(scaled(&Cholesky::new(scaled(&self.matrix))?.inverse()))
    }
}

impl Equations for Normal {
    type Work = DMatrix<f64>;

    fn solve(&self, damping: f64, work: &mut DMatrix<f64>, step: &mut DVector<f64>) -> bool {
        self.solve_damped(|_| damping, work, step)
    }
}
