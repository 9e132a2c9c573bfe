//! The filters through which each regressor passes: the last samples, the simulation's own resonances, and a few slow
//! poles. All of them are stable, and so is any sum of them.

use nalgebra::Complex;
use plid_gap::research::Plant;

/// Number of the most recent samples that are used, including the present one.
const LAGS: usize = 4;
/// Poles of first order.
const SLOW: [f64; 2] = [0.8, 0.97];
/// Largest number of resonances. Those of the lowest frequencies are used.
const RESONANCES: usize = 12;
/// Largest magnitude of a pole. At this magnitude, a filter remembers a few thousand samples.
const MOST: f64 = 0.9995;

/// The filters.
pub(super) struct Bank {
    poles: Vec<Complex<f64>>,
}

impl Bank {
    pub(super) fn new(plant: &Plant) -> Self {
        let resonances = plant.modes.iter().take(RESONANCES).map(|mode| (mode.pole / plant.rate).exp());
        let bounded = |pole: Complex<f64>| if pole.norm() > MOST { pole * (MOST / pole.norm()) } else { pole };
        Self { poles: resonances.map(bounded).collect() }
    }

    /// Returns the number of filters.
    pub(super) fn width(&self) -> usize {
        LAGS + SLOW.len() + 2 * self.poles.len()
    }

    /// Returns the output of each filter from rest.
    pub(super) fn filtered(&self, x: &[f64]) -> Vec<Vec<f64>> {
        let delayed = |lag: usize| (0..x.len()).map(|k| if k < lag { 0.0 } else { x[k - lag] }).collect();
        let mut all: Vec<Vec<f64>> = (0..LAGS).map(delayed).collect();
        for pole in SLOW {
            let mut state = 0.0;
            let run = |x: &f64| {
                state = pole * state + (1.0 - pole) * x;
                state
            };
            all.push(x.iter().map(run).collect());
        }
        for pole in &self.poles {
            let mut state = Complex::new(0.0, 0.0);
            let gain = 1.0 - pole.norm();
            let run = |x: &f64| {
                state = pole * state + gain * x;
                (state.re, state.im)
            };
            let (re, im) = x.iter().map(run).unzip();
            all.extend([re, im]);
        }
        all
    }
}
