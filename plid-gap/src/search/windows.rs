//! Short windows of the records, in which the search looks for effects that change the motion strongly.
//!
//! An effect that moves a resonance by more than its width cannot be found from long free runs, because these follow
//! the records only close to the right parameters. A free run of a few periods from a fitted initial state follows
//! them even far from the right parameters (multiple shooting; Bock, *Springer Series in Chemical Physics* 18, 1981,
//! 102).

use crate::case::record::{Channels, Record, rms};
use crate::fit::free_run::outputs;
use crate::fit::problem::{Effort, Fit, Placed, Problem};
use crate::fit::refit::Refit;
use crate::noise::NoiseModel;
use crate::simulate::Fineness;
use plid_fourier::forward;

/// Effort of a fit to longer windows. It starts near the minimum, and only has to stay there as the windows grow.
const GROWN: Effort = Effort { steps: 8, gain: 0.5, fineness: Fineness::COARSE };

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
    /// ends. Neither has a simulation with a displacement that no output shows: a window would begin anywhere, and no
    /// record says where.
    pub fn choose(problem: &Problem, refitted: &Refit) -> Option<Self> {
        let settings = &problem.settings.search;
        let unseen = problem.plant.seen_states() < problem.plant.n();
        if unseen || problem.nuisance.of_simulation() > settings.strong_parameters {
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

impl Windows {
    /// Cuts the records of a problem into these windows, and into longer ones, each twice as long as the one before,
    /// up to half a record.
    pub fn of(self, problem: &Problem, noise: &NoiseModel) -> Problem {
        let longest = problem.records.iter().filter(|r| r.is_driven()).map(Record::samples).max().unwrap_or(0);
        let cut = |Self { samples, each }: Self| problem.windows(samples, each, noise);
        let twice = |last: &Self| Some(Self { samples: 2 * last.samples, each: last.each.div_ceil(2) });
        let longer = std::iter::successors(twice(&self), twice).take_while(|windows| 2 * windows.samples <= longest);
        Problem { longer: longer.map(cut).collect(), ..cut(self) }
    }
}

/// Continues a fit to windows on whole records. If it does not lead there, it is repeated from a fit to ever longer
/// windows: the longer a free run, the closer to the right parameters its fit must start, and each fit leads close
/// enough for windows of twice the length. `finish` fits the whole records.
pub fn carried<'a>(
    problem: &Problem,
    windows: &Problem,
    fit: &Fit<'a>,
    finish: impl Fn(Fit<'a>) -> Fit<'a>,
) -> Fit<'a> {
    let at_once = finish(fit.clone());
    if windows.longer.is_empty() || follows(problem, &at_once.eta, &at_once.effects) {
        return at_once;
    }
    let slowly = finish(grown(problem, windows, fit.clone()));
    if slowly.is_better_than(&at_once) { slowly } else { at_once }
}

/// Repeats a fit to windows in ever longer ones, until the free runs of the whole records follow.
fn grown<'a>(problem: &Problem, windows: &Problem, mut fit: Fit<'a>) -> Fit<'a> {
    for longer in &windows.longer {
        if follows(problem, &fit.eta, &fit.effects) {
            break;
        }
        // Other windows have other initial states.
        let eta = &fit.eta[..problem.nuisance.len()];
        let jacobian = longer.jacobian(&longer.nuisance.apply(&longer.plant, eta));
        let next = longer.fit(&jacobian, eta, &fit.effects, longer.far(GROWN));
        if !next.cost.is_finite() {
            break;
        }
        fit = next;
    }
    fit
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
    use crate::effects::{Library, Place, Setting};
    use crate::fit::refit::{STEPS, refit};
    use crate::search::stage::polish;
    use crate::testing::laws::{at, prepared};
    use std::f64::consts::TAU;

    /// A cubic spring that moves the resonances by several of their widths. A fit that starts 40 % from its stiffness
    /// does not lead there from free runs of whole records, but does through ever longer windows.
    #[test]
    fn growing_windows_lead_to_whole_records() {
        let library = Library::standard();
        let stiffness: fn(&Setting) -> Vec<f64> = |setting| vec![0.1 * setting.stiffness[0] / setting.d_rms[0].powi(2)];
        let mut ready = prepared(&[("cubic-stiffness", stiffness)]);
        ready.problem.strong = true;
        let problem = &ready.problem;
        let refitted = refit(problem, STEPS);
        let windows = Windows::choose(problem, &refitted).expect("a strong effect").of(problem, &ready.noise);
        let lengths: Vec<usize> = windows.longer.iter().map(|windows| windows.records[1].samples()).collect();
        assert_eq!(lengths, [128, 256, 512, 1024]);
        let wrong = stiffness(&problem.setting).iter().map(|k| 0.6 * k).collect();
        let spring = at(&library, "cubic-stiffness", Place::Port(0), wrong);
        let start = Fit { effects: vec![spring], eta: vec![0.0; problem.nuisance.len()], ..refitted.as_fit() };
        let alone = polish(problem, start.clone());
        let carried = carried(problem, &windows, &start, |fit| polish(problem, fit));
        let rows = problem.rows() as f64;
        assert!(alone.cost > 100.0 * rows, "free runs suffice: {}", alone.cost / rows);
        assert!(carried.cost < 1.1 * rows, "{}", carried.cost / rows);
    }

    #[test]
    fn half_of_the_power_lies_below_the_median_frequency() {
        let tone = |hz: f64, size: f64| (0..1000).map(move |k| 5.0 + size * (TAU * hz * k as f64).sin());
        let both: Vec<f64> = tone(0.02, 1.0).zip(tone(0.2, 2.0)).map(|(a, b)| a + b).collect();
        assert_eq!(median_frequency(&vec![both]), 0.2);
        assert_eq!(median_frequency(&vec![tone(0.02, 1.0).collect(), tone(0.2, 0.5).collect()]), 0.02);
    }
}
