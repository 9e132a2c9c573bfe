//! The information of a run's data about the parameters: its Gaussian posterior without the prior.

use nalgebra::{DMatrix, DVector};

use super::MergeError;

/// The Gaussian posterior of one run over shared parameters and its own parameters.
#[derive(Clone, Debug)]
pub struct Knowledge {
    /// The name of the run in error messages.
    pub run: String,
    /// The indices of its parameters among all parameters, each occurring once.
    pub places: Vec<usize>,
    /// The estimate, one entry per index.
    pub estimate: DVector<f64>,
    /// The posterior covariance, in the square of the estimate's units.
    pub covariance: DMatrix<f64>,
    /// The variances of the independent prior of zero mean. A variance of zero fixes a parameter at zero.
    pub prior_variances: Vec<f64>,
    /// The factor by which the actual variances due to noise exceed `covariance`: 1 if its scale is correct.
    pub overdispersion: f64,
}

/// Data as rows of a least-squares problem: `rows` theta = `right`, with noise of unit variance on each row.
#[derive(Clone, Debug)]
pub(super) struct Rows {
    /// One column per parameter of the run.
    pub(super) rows: DMatrix<f64>,
    pub(super) right: DVector<f64>,
}

/// Directions about which the data have less than this fraction of the prior's information are omitted.
const NOTHING: f64 = 1e-10;
/// Tolerance by which a variance may exceed the prior's because of rounding, including single precision.
const ROUNDING: f64 = 1e-3;

impl Knowledge {
    /// Returns the data of the run without its prior, from P^-1 = P0^-1 + (information of the data).
    ///
    /// In units of the prior's standard deviations, P = L L'. With the singular values s of L, the data have the
    /// information 1/s^2 - 1 along the left singular vectors. P is never inverted, and s is exact to about 1e-16,
    /// whereas s^2 would not be.
    pub(super) fn data(&self) -> Result<Rows, MergeError> {
        let size = self.places.len();
        let free: Vec<usize> = (0..size).filter(|&k| self.prior_variances[k] > 0.0).collect();
        let deviations: Vec<f64> = free.iter().map(|&k| self.prior_variances[k].sqrt()).collect();
        let whitened = DMatrix::from_fn(free.len(), free.len(), |i, j| {
            let (a, b) = (free[i], free[j]);
            0.5 * (self.covariance[(a, b)] + self.covariance[(b, a)]) / (deviations[i] * deviations[j])
        });
        let factor = self.factor(&whitened, &free)?;
        let estimate = DVector::from_fn(free.len(), |i, _| self.estimate[free[i]] / deviations[i]);
        let decomposition = factor.svd(true, false);
        let directions = decomposition.u.expect("the left vectors were asked for");
        let mut kept = Vec::new();
        for (k, &singular) in decomposition.singular_values.iter().enumerate() {
            let share = singular * singular;
            if share > 1.0 + ROUNDING {
                return Err(MergeError::AbovePrior { run: self.run.clone(), factor: share });
            }
            if 1.0 - share > NOTHING {
                kept.push((k, share));
            }
        }
        let mut rows = DMatrix::zeros(kept.len(), size);
        let mut right = DVector::zeros(kept.len());
        for (row, &(k, share)) in kept.iter().enumerate() {
            let direction = directions.column(k);
            let weight = ((1.0 - share) / (share * self.overdispersion)).sqrt();
            for (i, &place) in free.iter().enumerate() {
                rows[(row, place)] = weight * direction[i] / deviations[i];
            }
            right[row] = direction.dot(&estimate) / (share * (1.0 - share) * self.overdispersion).sqrt();
        }
        Ok(Rows { rows, right })
    }

    /// Checks that sizes and signs of the numbers are those of a Gaussian distribution, on which the computation
    /// relies.
    pub(super) fn check(&self) -> Result<(), MergeError> {
        let size = self.places.len();
        let shapes = self.estimate.len() == size
            && self.covariance.shape() == (size, size)
            && self.prior_variances.len() == size;
        let finite = self.estimate.iter().chain(self.covariance.iter()).all(|x| x.is_finite());
        let priors = self.prior_variances.iter().all(|v| v.is_finite() && *v >= 0.0);
        let problem = if !shapes {
            "estimate, covariance and prior are of different sizes"
        } else if !finite {
            "the estimate or its covariance is not finite"
        } else if !priors {
            "a prior variance is negative or not finite"
        } else if !(self.overdispersion > 0.0 && self.overdispersion.is_finite()) {
            "the ratio of its innovations to their expected size is not above 0"
        } else {
            return Ok(());
        };
        Err(MergeError::Unusable { run: self.run.clone(), problem: problem.into() })
    }

    /// Returns L of P = L L'. The errors of the Cholesky factor are relative to each parameter's own variance,
    /// however much the variances differ.
    fn factor(&self, whitened: &DMatrix<f64>, free: &[usize]) -> Result<DMatrix<f64>, MergeError> {
        let size = whitened.nrows();
        let smallest = 4.0 * size as f64 * f64::EPSILON;
        let mut factor: DMatrix<f64> = DMatrix::zeros(size, size);
        for j in 0..size {
            for i in j..size {
                let above: f64 = (0..j).map(|k| factor[(i, k)] * factor[(j, k)]).sum();
                let left = whitened[(i, j)] - above;
                factor[(i, j)] = if i > j {
                    left / factor[(j, j)]
                } else if left > smallest * whitened[(j, j)] {
                    left.sqrt()
                } else {
                    return Err(MergeError::Indefinite { run: self.run.clone(), entry: free[j] });
                };
            }
        }
        Ok(factor)
    }
}
