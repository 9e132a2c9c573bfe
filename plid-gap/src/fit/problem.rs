//! A least-squares problem: records, a simulation and a noise model, and the whitened residual of free runs.

use std::sync::Arc;

use crate::case::record::{Channels, Record};
use crate::effects::{Action, Effect, Place, Setting};
pub use crate::fit::descent::{Effort, Fit};
pub use crate::fit::jacobian::Jacobian;
use crate::fit::nuisance::Nuisance;
use crate::noise::NoiseModel;
use crate::noise::whiten::Whitener;
use crate::plant::Plant;
use crate::settings::GapSettings;
use crate::simulate::{Fineness, simulate};

/// An effect at a location with its parameters.
#[derive(Clone)]
pub struct Placed<'a> {
    /// The effect.
    pub effect: &'a dyn Effect,
    /// Its location.
    pub place: Place,
    /// Its parameters, in the order of [`Effect::parameters`].
    pub parameters: Vec<f64>,
}

/// Records, simulation and noise model.
#[derive(Clone)]
pub struct Problem {
    /// The simulation as given.
    pub plant: Plant,
    /// The records that are fitted.
    pub records: Vec<Record>,
    /// The whitening of each record.
    pub whiteners: Vec<Whitener>,
    /// The linear parameters and their prior.
    pub nuisance: Nuisance,
    /// Properties of the simulation and its records that effects use.
    pub setting: Setting,
    /// Thresholds of the diagnosis.
    pub settings: Arc<GapSettings>,
}

impl Problem {
    /// Returns the problem with the first samples of each record only. The time of a search is proportional to them,
    /// and a record from rest still starts from rest.
    pub fn head(&self, samples: usize, noise: &NoiseModel) -> Self {
        let cut = |channels: &Channels| channels.iter().map(|x| x[..x.len().min(samples)].to_vec()).collect();
        let records: Vec<Record> = self
            .records
            .iter()
            .map(|record| Record { u: cut(&record.u), y: cut(&record.y), simulated: None, ..record.clone() })
            .collect();
        let whiteners = records
            .iter()
            .zip(&self.whiteners)
            .map(|(record, whole)| Whitener::new(record, noise, self.plant.rate, whole.masked.clone()))
            .collect();
        Self {
            plant: self.plant.clone(),
            whiteners,
            nuisance: self.nuisance.clone(),
            setting: self.setting.clone(),
            settings: self.settings.clone(),
            records,
        }
    }

    /// Returns the problem without one of the records, whose initial state remains among the linear parameters.
    pub fn without(&self, record: usize) -> Self {
        let mut others = self.clone();
        others.records.remove(record);
        others.whiteners.remove(record);
        others.nuisance.forget(record);
        others
    }

    /// Returns the number of rows of the whitened residual.
    pub fn rows(&self) -> usize {
        self.whiteners.iter().map(Whitener::rows).sum()
    }

    /// Returns the rows of one record.
    pub fn rows_of(&self, record: usize) -> std::ops::Range<usize> {
        let start = self.whiteners[..record].iter().map(Whitener::rows).sum();
        start..start + self.whiteners[record].rows()
    }

    /// Returns the actions of the effects on the simulation.
    pub fn actions(&self, effects: &[Placed]) -> Vec<Action> {
        effects.iter().flat_map(|placed| placed.effect.act(&self.setting, &placed.place, &placed.parameters)).collect()
    }

    /// Returns the plant with those effects that change it; `None` if none of them does.
    pub(super) fn changed(&self, plant: &Plant, effects: &[Placed]) -> Option<Plant> {
        let mut changed = None;
        for action in self.actions(effects) {
            if let Action::Plant(change) = action {
                change(changed.get_or_insert_with(|| plant.clone()));
            }
        }
        changed
    }

    /// Simulates the free run of one record.
    pub fn outputs(
        &self,
        plant: &Plant,
        eta: &[f64],
        actions: &[Action],
        index: usize,
        fineness: Fineness,
    ) -> Channels {
        let record = &self.records[index];
        let start = self.nuisance.start(index, eta);
        simulate(plant, actions, &record.u, record.start_s, start.as_ref(), fineness)
    }

    /// Returns the whitened residual of a linear model with effects, record after record.
    pub fn residual(&self, plant: &Plant, eta: &[f64], effects: &[Placed], fineness: Fineness) -> Vec<f64> {
        let actions = self.actions(effects);
        let mut to = vec![0.0; self.rows()];
        for index in 0..self.records.len() {
            let outputs = self.outputs(plant, eta, &actions, index, fineness);
            let range = self.rows_of(index);
            self.whitened_error(index, &outputs, &mut to[range]);
        }
        to
    }

    fn whitened_error(&self, index: usize, outputs: &[Vec<f64>], to: &mut [f64]) {
        self.whiteners[index].apply(&self.records[index].error(outputs), to);
    }

    /// Returns the sum of squares of eta / std, which the prior adds to the cost.
    pub fn penalty(&self, eta: &[f64]) -> f64 {
        eta.iter().zip(&self.nuisance.std).map(|(x, std)| (x / std).powi(2)).sum()
    }

    /// Returns the largest change of a parameter of the simulation, in standard deviations of its prior.
    pub fn max_prior_z(&self, eta: &[f64]) -> f64 {
        let z = |index: usize| (eta[index] / self.nuisance.std[index]).abs();
        (0..self.nuisance.of_simulation()).map(z).fold(0.0, f64::max)
    }
}

/// Returns the sum of the squares of all entries.
pub fn sum_of_squares(x: &[f64]) -> f64 {
    dot(x, x)
}

/// Returns the inner product of two vectors.
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
