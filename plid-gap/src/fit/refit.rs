//! The bounded refit: the linear parameters within their prior, before any effect.

use nalgebra::DMatrix;

use crate::fit::descent::{Effort, Fit, Point};
use crate::fit::jacobian::Jacobian;
use crate::fit::problem::{Problem, sum_of_squares};
use crate::plant::Plant;
use crate::simulate::Fineness;

/// A linear model of the records.
#[derive(Clone)]
pub struct Refit {
    /// Linear parameters.
    pub eta: Vec<f64>,
    /// The simulation with them.
    pub plant: Plant,
    /// Derivatives at this model.
    pub jacobian: Jacobian,
    /// Whitened residual.
    pub residual: Vec<f64>,
    /// Sum of squares of residual and eta / std.
    pub cost: f64,
}

impl Refit {
    /// Returns the refit as a fit without effects.
    pub fn as_fit<'a>(&self) -> Fit<'a> {
        Fit {
            eta: self.eta.clone(),
            effects: Vec::new(),
            residual: self.residual.clone(),
            cost: self.cost,
            covariance: DMatrix::zeros(0, 0),
            converged: true,
        }
    }
}

/// Largest number of steps within the prior's bounds: the model is close to linear in its parameters there.
pub const STEPS: usize = 5;

/// A step that lowers the cost by less than this is the last one, because an effect counts only if it gains more than
/// ten.
const LEAST_GAIN: f64 = 1.0;

/// Fits the linear parameters alone.
pub fn refit(problem: &Problem, steps: usize) -> Refit {
    let effort = Effort { steps, gain: LEAST_GAIN, fineness: Fineness::FINE };
    let (Point { eta, plant, residual, cost, .. }, jacobian) = problem.fit_linear(effort);
    Refit { eta, plant, jacobian, residual, cost }
}

impl Refit {
    /// Computes residual and cost for a changed noise model.
    pub fn weigh_anew(&mut self, problem: &Problem) {
        self.residual = problem.residual(&self.plant, &self.eta, &[], Fineness::FINE);
        self.cost = sum_of_squares(&self.residual) + problem.penalty(&self.eta);
    }

    /// Returns the linear parameters, brought back to within the limits.
    pub fn within_limits(&self, problem: &Problem) -> Vec<f64> {
        clipped(problem, &self.eta).unwrap_or_else(|| self.eta.clone())
    }
}

/// Returns the linear parameters brought back to within `prior_bound` standard deviations; `None` if all are within.
pub fn clipped(problem: &Problem, eta: &[f64]) -> Option<Vec<f64>> {
    let most = problem.settings.fit.prior_bound;
    let bound = |(x, std): (&f64, &f64)| x.clamp(-most * std, most * std);
    let all: Vec<f64> = eta.iter().zip(&problem.nuisance.std).map(bound).collect();
    (all != eta).then_some(all)
}
