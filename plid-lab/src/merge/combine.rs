//! The combination of runs as one least-squares problem of all data and a common prior.

use nalgebra::{DMatrix, DVector};

use super::MergeError;
use super::knowledge::{Knowledge, Rows};

/// A Gaussian distribution of all parameters.
#[derive(Clone, Debug)]
pub struct Combined {
    /// The estimate, one entry per parameter.
    pub estimate: DVector<f64>,
    /// The covariance of the estimate.
    pub covariance: DMatrix<f64>,
    /// The variances of the common prior, which is counted once.
    pub prior_variances: Vec<f64>,
}

/// Combines the information of several runs about `size` parameters. Their data are independent, and their common prior
/// is counted once.
///
/// With S_j theta = d_j the data of run j, and in units of the prior's standard deviations, theta minimises |theta|^2 +
/// sum_j |S_j theta - d_j|^2. The rows are triangularised by Householder reflections, so that no normal equations are
/// formed. The B column of an input becomes the conditional estimate given the A of all runs.
///
/// # Errors
/// Returns an error for a run whose covariance is not positive definite or exceeds its prior, and for priors that
/// contradict each other.
pub fn combine(runs: &[Knowledge], size: usize) -> Result<Combined, MergeError> {
    let prior_variances = common_prior(runs, size)?;
    let data = runs.iter().map(Knowledge::data).collect::<Result<Vec<_>, _>>()?;
    let pieces: Vec<(&Knowledge, &Rows)> = runs.iter().zip(&data).collect();
    let (estimate, root) = solve(&pieces, &prior_variances);
    let mut covariance = &root * root.transpose();
    for i in 0..size {
        for j in 0..size {
            covariance[(i, j)] *= (prior_variances[i] * prior_variances[j]).sqrt();
        }
    }
    let estimate = DVector::from_fn(size, |i, _| estimate[i] * prior_variances[i].sqrt());
    Ok(Combined { estimate, covariance, prior_variances })
}

/// Returns the common prior of the runs. If the priors differ slightly, for example by the scales of their channels,
/// their information is averaged.
pub(super) fn common_prior(runs: &[Knowledge], size: usize) -> Result<Vec<f64>, MergeError> {
    runs.iter().try_for_each(Knowledge::check)?;
    let mut common = vec![0.0; size];
    for (place, variance) in common.iter_mut().enumerate() {
        let theirs: Vec<(f64, &str)> = runs
            .iter()
            .filter_map(|run| {
                let k = run.places.iter().position(|&p| p == place)?;
                Some((run.prior_variances[k], run.run.as_str()))
            })
            .collect();
        let held = theirs.iter().find(|(v, _)| *v == 0.0);
        let free = theirs.iter().find(|(v, _)| *v > 0.0);
        match (held, free) {
            (Some((_, held)), Some((_, free))) => {
                return Err(MergeError::Priors { held: (*held).into(), free: (*free).into(), place });
            }
            (None, Some(_)) => {
                *variance = theirs.len() as f64 / theirs.iter().map(|(v, _)| 1.0 / v).sum::<f64>();
            }
            _ => {}
        }
    }
    Ok(common)
}

/// Returns the estimate and a square root of its covariance, both in units of the prior's standard deviations; they are
/// zero for parameters that the prior fixes.
pub(super) fn solve(pieces: &[(&Knowledge, &Rows)], prior_variances: &[f64]) -> (DVector<f64>, DMatrix<f64>) {
    let size = prior_variances.len();
    let free: Vec<usize> = (0..size).filter(|&k| prior_variances[k] > 0.0).collect();
    let mut column = vec![None; size];
    free.iter().enumerate().for_each(|(k, &place)| column[place] = Some(k));
    let count = free.len() + pieces.iter().map(|(_, data)| data.rows.nrows()).sum::<usize>();
    // The first rows are those of the prior: the identity, and zero on the right-hand side.
    let mut rows = DMatrix::zeros(count, free.len());
    let mut right = DVector::zeros(count);
    rows.view_mut((0, 0), (free.len(), free.len())).fill_with_identity();
    let mut top = free.len();
    for (run, data) in pieces {
        for (k, &place) in run.places.iter().enumerate() {
            if let Some(to) = column[place] {
                let scaled = data.rows.column(k) * prior_variances[place].sqrt();
                rows.view_mut((top, to), (scaled.len(), 1)).copy_from(&scaled);
            }
        }
        right.rows_mut(top, data.right.len()).copy_from(&data.right);
        top += data.right.len();
    }
    let decomposition = rows.qr();
    decomposition.q_tr_mul(&mut right);
    let triangle = decomposition.r();
    // The rows of the prior keep every diagonal entry at one or above, so the triangular solves cannot fail.
    let mut solution = right.rows(0, free.len()).into_owned();
    let solved = triangle.solve_upper_triangular_mut(&mut solution);
    let mut inverse = DMatrix::identity(free.len(), free.len());
    let inverted = triangle.solve_upper_triangular_mut(&mut inverse);
    debug_assert!(solved && inverted);
    let mut estimate = DVector::zeros(size);
    let mut root = DMatrix::zeros(size, free.len());
    for (k, &place) in free.iter().enumerate() {
        estimate[place] = solution[k];
        root.row_mut(place).copy_from(&inverse.row(k));
    }
    (estimate, root)
}
