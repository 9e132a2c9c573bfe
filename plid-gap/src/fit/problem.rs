//! A least-squares problem: records, a simulation and a noise model, and the whitened residual of free runs.

use std::sync::Arc;

use crate::case::record::{Channels, Record};
use crate::effects::{Action, Effect, Place, Sampling, Setting};
pub use crate::fit::descent::{Effort, Fit};
pub use crate::fit::jacobian::Jacobian;
use crate::fit::nuisance::Nuisance;
use crate::noise::NoiseModel;
use crate::noise::whiten::Whitener;
use crate::plant::Plant;
use crate::settings::GapSettings;
use crate::simulate::{Fineness, Run, apply_sensors, before_sensors, changed_modes, simulate};

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
    /// Whether effects change the motion so much that the search uses windows.
    pub strong: bool,
    /// If the records are windows of longer ones: the same records in longer windows, the shortest first.
    pub longer: Vec<Problem>,
}

impl Problem {
    /// Returns the problem with the first samples of each record only. The time of a search is proportional to their
    /// number, and a record from rest still starts from rest.
    pub fn head(&self, samples: usize, noise: &NoiseModel) -> Self {
        let head = |record: &Record| record.part(0..record.samples().min(samples), self.plant.rate);
        let records: Vec<Record> = self.records.iter().map(head).collect();
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
            strong: self.strong,
            longer: Vec::new(),
            records,
        }
    }

    /// Returns the problem with at most `most` windows of each driven record, evenly spaced, each with an initial state
    /// of its own.
    pub fn windows(&self, samples: usize, most: usize, noise: &NoiseModel) -> Self {
        let (mut records, mut whiteners, mut kept) = (Vec::new(), Vec::new(), Vec::new());
        for (record, whole) in self.records.iter().zip(&self.whiteners) {
            let length = if record.is_driven() { samples.min(record.samples()) } else { record.samples() };
            let all = record.samples() / length;
            let count = all.min(most);
            let chosen: Vec<usize> = (0..count).map(|k| k * all / count).collect();
            for range in chosen.iter().map(|k| k * length..(k + 1) * length) {
                let window = record.part(range.clone(), self.plant.rate);
                let inside = |all: &Vec<usize>| {
                    all.iter().filter(|at| range.contains(at)).map(|at| at - range.start).collect::<Vec<usize>>()
                };
                let masked = whole.masked.iter().map(inside).collect();
                whiteners.push(Whitener::new(&window, noise, self.plant.rate, masked));
                records.push(window);
            }
            kept.push(count);
        }
        Self { records, whiteners, nuisance: self.nuisance.clone().with_windows(&kept), ..self.clone() }
    }

    /// Returns the problem without one of the records, whose initial state remains among the linear parameters.
    pub fn without(&self, record: usize) -> Self {
        let mut others = self.clone();
        others.records.remove(record);
        others.whiteners.remove(record);
        others.nuisance.forget(record);
        others
    }

    /// Returns the problem with the records whose inputs have at most this RMS.
    pub fn up_to_level(&self, most: f64) -> Self {
        let louder = (0..self.records.len()).rev().filter(|&k| self.records[k].level() > most);
        louder.fold(self.clone(), |problem, k| problem.without(k))
    }

    /// Returns the number of rows of the whitened residual.
    pub fn rows(&self) -> usize {
        self.whiteners.iter().map(Whitener::rows).sum()
    }

    /// Returns the number of values that count in a sum of squares: the rows, less those of ignored samples.
    pub fn values(&self) -> f64 {
        self.whiteners.iter().map(Whitener::values).sum()
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

    /// Returns the plant with those effects that change its modes; `None` if none of them does.
    pub(super) fn changed(&self, plant: &Plant, effects: &[Placed]) -> Option<Plant> {
        changed_modes(plant, &self.actions(effects))
    }

    /// Returns whether the fits use the derivatives of the simulation with the effects, which take a run for each
    /// linear parameter. They do so if these parameters are few or effects change the motion strongly. The
    /// derivatives of the linear simulation are misleading there, and where the linear parameters have absorbed
    /// nearly all of an effect.
    pub fn few(&self) -> bool {
        self.strong || self.has_numbers()
    }

    /// Returns whether the refit can represent a change of any physical parameter of the simulation, such as a gain
    /// or an inertia, because the few linear parameters are functions of the physical ones.
    pub fn has_numbers(&self) -> bool {
        self.nuisance.of_simulation() <= self.settings.search.few_parameters
    }

    /// Returns whether an effect loads the plant, or acts inside a loop, and the linear parameters are few enough
    /// for the derivatives of the simulation with its effects. Such a change and the poles that it moves look alike,
    /// so derivatives without it are misleading.
    pub fn is_loaded(&self, effects: &[Placed]) -> bool {
        let few = self.nuisance.of_simulation() <= self.settings.search.strong_parameters;
        let closed = self.plant.controller.is_some();
        let loads = |action: &Action| match action {
            Action::Load(..) => true,
            Action::Plant(_) => closed,
            _ => closed && action.is_between(),
        };
        few && self.actions(effects).iter().any(loads)
    }

    /// Returns whether runs with and without the actions are identical before the sensors. A controller reads what the
    /// sensors show.
    pub fn are_on_sensors(&self, actions: &[Action]) -> bool {
        self.plant.controller.is_none() && actions.iter().all(Action::is_on_sensors)
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
        self.residuals(plant, eta, &[self.actions(effects)], fineness).swap_remove(0)
    }

    /// Returns the whitened residuals of a linear model, with several sets of actions.
    pub fn residuals(&self, plant: &Plant, eta: &[f64], sets: &[Vec<Action>], fineness: Fineness) -> Vec<Vec<f64>> {
        // Each run holds its command and its outputs in memory, so not all are run at once.
        const AT_ONCE: usize = 8;
        let count = self.records.len();
        let residuals = |sets: &[Vec<Action>]| -> Vec<Vec<f64>> {
            let mut outputs = self.before_sensors(plant, eta, sets, fineness).into_iter();
            sets.iter().map(|actions| self.residual_from(outputs.by_ref().take(count), actions)).collect()
        };
        sets.chunks(AT_ONCE).flat_map(residuals).collect()
    }

    /// Simulates the free runs of all records with each set of actions, before the effects on the sensors.
    pub fn before_sensors(
        &self,
        plant: &Plant,
        eta: &[f64],
        sets: &[Vec<Action>],
        fineness: Fineness,
    ) -> Vec<Channels> {
        let starts: Vec<_> = (0..self.records.len()).map(|index| self.nuisance.start(index, eta)).collect();
        let runs: Vec<Run> = (sets.iter())
            .flat_map(|actions| self.records.iter().zip(&starts).map(move |(record, start)| (actions, record, start)))
            .map(|(actions, record, start)| Run { actions, u: &record.u, t0: record.start_s, start: start.as_ref() })
            .collect();
        before_sensors(plant, &runs, fineness)
    }

    /// Returns the whitened residual of the records' free runs, to which the effects on the sensors are applied first.
    pub fn residual_from(&self, outputs: impl Iterator<Item = Channels>, actions: &[Action]) -> Vec<f64> {
        let mut to = vec![0.0; self.rows()];
        for (index, (record, mut y)) in self.records.iter().zip(outputs).enumerate() {
            let at_rest = self.nuisance.starts_at_rest(index);
            apply_sensors(actions, &mut y, Sampling { t0: record.start_s, rate: self.plant.rate, at_rest });
            self.whiteners[index].apply(&record.error(&y), &mut to[self.rows_of(index)]);
        }
        to
    }

    /// Returns the whitened residual of one record.
    pub(super) fn residual_of(
        &self,
        index: usize,
        plant: &Plant,
        eta: &[f64],
        actions: &[Action],
        fineness: Fineness,
    ) -> Vec<f64> {
        let outputs = self.outputs(plant, eta, actions, index, fineness);
        let mut to = vec![0.0; self.whiteners[index].rows()];
        self.whiteners[index].apply(&self.records[index].error(&outputs), &mut to);
        to
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
