//! The bounded refit: the linear parameters within their prior, before any effect.

use nalgebra::DMatrix;

use crate::fit::problem::{Fit, Problem, Tangent, sum_of_squares};
use crate::plant::Plant;
use crate::simulate::Fineness;

/// A linear model of the records.
#[derive(Clone)]
pub struct Refit {
    /// Linear parameters.
    pub eta: Vec<f64>,
    /// The simulation with them.
    pub plant: Plant,
    /// Derivatives there.
    pub tangent: Tangent,
    /// Whitened residual.
    pub residual: Vec<f64>,
    /// Sum of squares of residual and eta / std.
    pub cost: f64,
}

impl Refit {
    /// The same as a fit without effects.
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

/// Gauss-Newton steps at most within the prior's bounds; the derivatives are renewed at each.
pub const STEPS: usize = 5;

/// Of a step, in turn until one lowers the cost (Marquardt 1963).
const DAMPINGS: [f64; 7] = [0.0, 0.01, 0.1, 1.0, 10.0, 100.0, 1000.0];

/// Fits the linear parameters alone.
pub fn refit(problem: &Problem, steps: usize) -> Refit {
    let mut eta = vec![0.0; problem.nuisance.len()];
    let mut plant = problem.plant.clone();
    let mut residual = problem.residual(&plant, &eta, &[], Fineness::FINE);
    let mut cost = sum_of_squares(&residual);
    let mut tangent = problem.tangent(&plant);
    for _ in 0..steps {
        let gradient = problem.gradient(&tangent, &residual, &eta);
        let mut gain = 0.0;
        for damping in DAMPINGS {
            let mut normal = tangent.normal.clone();
            (0..normal.nrows()).for_each(|i| normal[(i, i)] *= 1.0 + damping);
            let Some(factor) = normal.cholesky() else { continue };
            let step = factor.solve(&gradient);
            let trial: Vec<f64> = eta.iter().zip(step.iter()).map(|(x, dx)| x + dx).collect();
            let trial_plant = problem.nuisance.apply(&problem.plant, &trial);
            let trial_residual = problem.residual(&trial_plant, &trial, &[], Fineness::FINE);
            let trial_cost = sum_of_squares(&trial_residual) + problem.penalty(&trial);
            if trial_cost < cost {
                gain = cost - trial_cost;
                (eta, plant, residual, cost) = (trial, trial_plant, trial_residual, trial_cost);
                break;
            }
        }
        if gain <= 0.0 {
            break;
        }
        tangent = problem.tangent(&plant);
        if gain < 1.0 {
            break;
        }
    }
    Refit { eta, plant, tangent, residual, cost }
}

/// Parts of a refit that lie further out than this many standard deviations are no nuisance, but the trace of an effect.
const FAR: f64 = 2.5;

impl Refit {
    /// Residual and cost under a changed noise model.
    pub fn weigh_anew(&mut self, problem: &Problem) {
        self.residual = problem.residual(&self.plant, &self.eta, &[], Fineness::FINE);
        self.cost = sum_of_squares(&self.residual) + problem.penalty(&self.eta);
    }
}

/// Linear parameters brought back to the prior's bounds; none if all are within.
pub fn clipped(problem: &Problem, eta: &[f64]) -> Option<Vec<f64>> {
    let bound = |(x, std): (&f64, &f64)| x.clamp(-FAR * std, FAR * std);
    let all: Vec<f64> = eta.iter().zip(&problem.nuisance.std).map(bound).collect();
    (all != eta).then_some(all)
}
