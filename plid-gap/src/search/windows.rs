//! Short windows of the records, in which the search looks for effects that change the motion strongly.
//!
//! An effect that moves a resonance by more than its width cannot be found from long free runs, because these follow
//! the records only close to the right parameters. A free run of a few periods from a fitted initial state follows
//! them even far from the right parameters (multiple shooting; Bock, *Springer Series in Chemical Physics* 18, 1981,
//! 102).

use crate::case::record::{Channels, Record, rms};
use crate::fit::free_run::outputs;
use crate::fit::problem::{Placed, Problem};
use crate::fit::refit::Refit;
use plid_fourier::forward;

/// The windows of each driven record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Windows {
    /// Number of samples of a window.
    pub samples: usize,
    /// Largest number of windows of a record.
    pub each: usize,
}

impl Windows {
    /// Chooses the windows; `None` if the free runs of the refit follow all records. A simulation with many linear
    /// parameters has no windows: with so many initial states, only a few windows would be affordable. They would
    /// contain too little of the records, and effects with a memory, such as delays, would be distorted at their
    /// ends.
    pub fn choose(problem: &Problem, refitted: &Refit) -> Option<Self> {
        let settings = &problem.settings.search;
        if problem.nuisance.of_simulation() > settings.strong_parameters {
            return None;
        }
        if follows(problem, &refitted.eta, &[]) {
            return None;
        }
        let driven = || problem.records.iter().filter(|record| record.is_driven());
        let states = problem.nuisance.states().max(1);
        let slowest = driven().map(|record| median_frequency(&record.y)).fold(f64::INFINITY, f64::min);
        let samples = (settings.windows_periods / slowest) as usize;
        Some(Self {
            samples: samples.max(settings.least_window).max(4 * states),
            each: (settings.window_states / states / driven().count()).max(1),
        })
    }
}

/// Returns whether the free runs with these parameters follow all driven records, so that no windows are needed.
pub fn follows(problem: &Problem, eta: &[f64], effects: &[Placed]) -> bool {
    let simulated = outputs(problem, eta, effects);
    let mut driven = problem.records.iter().zip(&simulated).filter(|(record, _)| record.is_driven());
    driven.all(|(record, simulated)| gap(record, simulated) < problem.settings.search.windows_gap)
}

/// Returns the largest relative RMS error of an output.
fn gap(record: &Record, simulated: &[Vec<f64>]) -> f64 {
    let error = record.error(simulated);
    let relative = |(error, y): (&Vec<f64>, &Vec<f64>)| {
        rms(error) / rms(y.iter().filter(|y| y.is_finite())).max(f64::MIN_POSITIVE)
    };
    error.iter().zip(&record.y).map(relative).fold(0.0, f64::max)
}

/// Returns the frequency below which half of the power of all channels lies, in cycles per sample. The mean of a
/// channel does not count.
fn median_frequency(y: &Channels) -> f64 {
    let samples = y.first().map_or(1, Vec::len);
    let mut power = vec![0.0; samples / 2 + 1];
    for y in y {
        let measured: Vec<f64> = y.iter().map(|y| if y.is_finite() { *y } else { 0.0 }).collect();
        power.iter_mut().zip(forward(&measured)).skip(1).for_each(|(power, bin)| *power += bin.norm_sqr());
    }
    let half = power.iter().sum::<f64>() / 2.0;
    let mut below = 0.0;
    let bin = power.iter().position(|power| {
        below += power;
        below >= half
    });
    bin.unwrap_or(1).max(1) as f64 / samples as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    #[test]
    fn half_of_the_power_lies_below_the_median_frequency() {
        let tone = |hz: f64, size: f64| (0..1000).map(move |k| 5.0 + size * (TAU * hz * k as f64).sin());
        let both: Vec<f64> = tone(0.02, 1.0).zip(tone(0.2, 2.0)).map(|(a, b)| a + b).collect();
        assert_eq!(median_frequency(&vec![both]), 0.2);
        assert_eq!(median_frequency(&vec![tone(0.02, 1.0).collect(), tone(0.2, 0.5).collect()]), 0.02);
    }
}
