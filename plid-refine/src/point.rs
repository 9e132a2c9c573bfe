//! A model of sections with the initial states of its records, and its free-run error.

use nalgebra::DVector;
use rayon::prelude::*;

use crate::error::RefineError;
use crate::gram::{gram, places, squares};
use crate::normal::{Free, Normal, Order, Step};
use crate::record::{Data, Start};
use crate::sections::Sections;

/// A variance is not taken below this share of its output's power: what is left then is rounding.
const FLOOR: f64 = 1e-28;
/// Damping of the linear fits: enough where two sections say the same, and undone by the rounds that follow.
const LINEAR_DAMPING: f64 = 1e-10;
/// Rounds of the linear fit: each one corrects what damping and rounding have left.
const ROUNDS: usize = 4;

#[derive(Clone, Debug)]
pub(crate) struct Point {
    pub model: Sections,
    /// One a record, padded as the sections are; None at rest.
    pub initial: Vec<Option<DVector<f64>>>,
}

impl Point {
    pub fn new(model: Sections, data: &Data) -> Self {
        let size = 2 * model.poles.len();
        let initial = |start: Start| (start == Start::Unknown).then(|| DVector::zeros(size));
        Self { initial: data.records.iter().map(|r| initial(r.start)).collect(), model }
    }

    /// Mean square free-run error of each output.
    pub fn variances(&self, data: &Data) -> Vec<f64> {
        let sums: Vec<Vec<f64>> = data
            .records
            .par_iter()
            .zip(&self.initial)
            .map(|(record, initial)| squares(record, &self.model, initial.as_ref()))
            .collect();
        let present = data.present();
        (0..data.p()).map(|i| sums.iter().map(|s| s[i]).sum::<f64>() / present[i].max(1) as f64 + FLOOR).collect()
    }

    /// J'WJ and J'We, each output weighted by the inverse of `variances`.
    pub fn normal(&self, data: &Data, variances: &[f64], free: Free) -> Normal {
        let mut normal = Normal::new(&self.model, data.records.len());
        let weights: Vec<f64> = variances.iter().map(|v| 1.0 / v).collect();
        for (number, (record, initial)) in data.records.iter().zip(&self.initial).enumerate() {
            let grams = gram(record, &self.model, initial.as_ref());
            let places = places(record, &self.model);
            normal.add(number, &self.model, initial.as_ref(), &places, &grams, &weights, free);
        }
        normal
    }

    /// The point a step on.
    pub fn moved(&self, step: &Step, free: Free) -> Self {
        let mut to = self.clone();
        let order = Order::of(&self.model);
        let (n, m, radius) = (self.model.states, self.model.m(), self.model.radius);
        if free == Free::All {
            for (s, section) in to.model.poles.iter_mut().enumerate() {
                let mut eta = section.coordinates(radius);
                let coordinates = if section.is_pair() { 2 } else { 1 };
                for (coordinate, eta) in eta.iter_mut().enumerate().take(coordinates) {
                    *eta += step.shared[order.pole(s, coordinate)];
                }
                section.place(eta, radius);
            }
            for i in 0..self.model.p() {
                for state in 0..n {
                    to.model.c[(i, state)] += step.shared[order.c(i, state)];
                }
            }
        }
        for j in 0..m {
            for state in 0..n {
                to.model.b[(state, j)] += step.shared[order.b(state, j)];
            }
            for i in (0..self.model.p()).filter(|_| self.model.feedthrough) {
                to.model.d[(i, j)] += step.shared[order.d(i, j)];
            }
        }
        for (state, change) in to.initial.iter_mut().zip(&step.initial) {
            if let (Some(state), Some(change)) = (state, change) {
                state.rows_mut(0, n).iter_mut().zip(change).for_each(|(x, dx)| *x += dx);
            }
        }
        to
    }

    /// Fits B, D and the initial states, in which the free run is linear, by least squares with given poles and C.
    ///
    /// # Errors
    /// If the normal equations cannot be solved.
    pub fn fit_inputs(mut self, data: &Data) -> Result<Self, RefineError> {
        let mut best = f64::INFINITY;
        for _ in 0..ROUNDS {
            let ones = vec![1.0; data.p()];
            let normal = self.normal(data, &ones, Free::Inputs);
            let failed = RefineError::Decomposition { what: "the least-squares fit of B and D" };
            let next = self.moved(&normal.step(LINEAR_DAMPING).ok_or(failed)?, Free::Inputs);
            let error: f64 = next.variances(data).iter().sum();
            if !(error < best) {
                break;
            }
            (self, best) = (next, error);
        }
        Ok(self)
    }
}
