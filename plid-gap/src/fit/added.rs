//! The changes of the whitened outputs by further effects, each added alone to a linear model with effects.

use crate::case::record::Channels;
use crate::effects::Action;
use crate::fit::problem::{Placed, Problem};
use crate::plant::Plant;
use crate::simulate::Fineness;

/// A linear model with effects, and its runs. They are as coarse as the runs with a further effect, so that the errors
/// of the discretisation cancel.
pub struct Before<'p, 'a> {
    problem: &'p Problem,
    plant: &'p Plant,
    eta: &'p [f64],
    effects: &'p [Placed<'a>],
    /// Outputs of all records before the effects on the sensors.
    before_sensors: Vec<Channels>,
    /// The whitened residual.
    pub residual: Vec<f64>,
}

impl<'p, 'a> Before<'p, 'a> {
    pub fn new(problem: &'p Problem, plant: &'p Plant, eta: &'p [f64], effects: &'p [Placed<'a>]) -> Self {
        let actions = vec![problem.actions(effects)];
        let before_sensors = problem.before_sensors(plant, eta, &actions, Fineness::COARSE);
        let residual = problem.residual_from(before_sensors.iter().cloned(), &actions[0]);
        Self { problem, plant, eta, effects, before_sensors, residual }
    }

    /// Returns the change of the whitened outputs by each of these effects alone. An effect on the sensors needs no
    /// run.
    pub fn added<'e>(&self, further: impl IntoIterator<Item = &'e Placed<'e>>) -> Vec<Vec<f64>> {
        let problem = self.problem;
        let more: Vec<Vec<Action>> =
            further.into_iter().map(|placed| problem.actions(std::slice::from_ref(placed))).collect();
        let without_run = more.iter().all(|more| problem.are_on_sensors(more));
        let sets: Vec<Vec<Action>> =
            more.into_iter().map(|more| problem.actions(self.effects).into_iter().chain(more).collect()).collect();
        let residuals = if without_run {
            let residual = |actions: &Vec<Action>| problem.residual_from(self.before_sensors.iter().cloned(), actions);
            sets.iter().map(residual).collect()
        } else {
            problem.residuals(self.plant, self.eta, &sets, Fineness::COARSE)
        };
        let change = |with: Vec<f64>| self.residual.iter().zip(&with).map(|(a, b)| a - b).collect();
        residuals.into_iter().map(change).collect()
    }
}
