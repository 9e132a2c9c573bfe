//! The black box: a Wiener-Hammerstein model of the residual of the linear simulation. Curves of the simulation's
//! signals pass through a bank of stable filters into each output, with separate coefficients for each output. The
//! black box names nothing. The gap that it leaves is that of a model without any physics except the linear simulation.
//!
//! It has no feedback from its own outputs, so its free run cannot diverge.

mod bank;
mod regressors;
mod selection;

use plid_gap::case::{Channels, Record};
use plid_gap::research::{Plant, Prepared};
use plid_model::signal::rms;
use serde::{Deserialize, Serialize};

use bank::Bank;
use regressors::{Extent, Regressor, Run, signals};
use selection::Lesson;

/// The black box as an answer stores it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BlackBox {
    /// Whether it corrects the linear refit; otherwise it corrects the simulation as given. Of the two, the one with
    /// the smaller gap on the record by which the model was selected is corrected.
    pub of_refit: bool,
    /// The ranges of the signals: the inputs, the outputs, the displacement and the velocity of each port, and the
    /// change of each input.
    pub extents: Vec<Extent>,
    /// End of the records from which it learnt, in s.
    pub end_s: f64,
    /// The regressors in the order in which they were chosen.
    pub terms: Vec<Term>,
}

/// A regressor with its coefficients.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Term {
    /// The regressor.
    pub regressor: Regressor,
    /// The coefficient of each filter, for each output.
    pub coefficients: Vec<Vec<f64>>,
}

/// Learns from the fitted records. The held-out record selects the number of regressors and the regularisation, and
/// then contributes to the coefficients as well.
pub(super) fn learn(ready: &Prepared, refitted: &Plant) -> BlackBox {
    let given = &ready.problem.plant;
    let (fitted, held_out) = (&ready.problem.records, &ready.held_out);
    let records: Vec<&Record> = fitted.iter().chain(held_out).collect();
    let scale: Vec<f64> = (0..given.p).map(|o| rms(fitted.iter().flat_map(|r| &r.y[o]).filter(finite))).collect();
    let runs = |plant: &Plant| -> Vec<Channels> { records.iter().map(|record| signals(plant, &record.u)).collect() };
    let left = |runs: &[Channels]| -> Vec<Channels> {
        records.iter().zip(runs).map(|(record, signals)| left(record, &signals[given.m..], &scale)).collect()
    };
    let bases = [given, refitted].map(|plant| {
        let runs = runs(plant);
        let left = left(&runs);
        (runs, left)
    });
    let squares = |left: &[Channels]| -> f64 {
        left[fitted.len()..].iter().flatten().flatten().filter(finite).map(|x| x * x).sum()
    };
    let of_refit = squares(&bases[1].1) < squares(&bases[0].1);
    let [as_given, refit] = bases;
    let ((runs, left), plant) = if of_refit { (refit, refitted) } else { (as_given, given) };
    let extents = extents(&runs);
    let end_s = records.iter().map(|r| r.start_s + r.samples() as f64 / given.rate).fold(0.0, f64::max);
    let runs = records.iter().zip(runs).map(|(r, signals)| run(signals, r.start_s, given.rate, end_s));
    let lessons: Vec<Lesson> = runs.zip(left).map(|(run, left)| Lesson { run, left }).collect();
    let (learnt, selecting) = lessons.split_at(fitted.len());
    let terms = selection::terms(learnt, selecting, &extents, plant, &scale);
    BlackBox { of_refit, extents, end_s, terms }
}

fn finite(x: &&f64) -> bool {
    x.is_finite()
}

/// Returns the residual of a simulation at each output relative to its scale, with NaN where the output was not
/// measured.
fn left(record: &Record, simulated: &[Vec<f64>], scale: &[f64]) -> Channels {
    let one = |((y, s), scale): ((&Vec<f64>, &Vec<f64>), &f64)| {
        y.iter().zip(s).map(|(y, s)| (y - s) / scale.max(f64::MIN_POSITIVE)).collect()
    };
    record.y.iter().zip(simulated).zip(scale).map(one).collect()
}

fn run(signals: Channels, start_s: f64, rate: f64, end_s: f64) -> Run {
    let samples = signals.first().map_or(0, Vec::len);
    let times = (0..samples).map(|k| (start_s + k as f64 / rate) / end_s.max(f64::MIN_POSITIVE)).collect();
    Run { signals, times }
}

/// Returns the range of each signal over all records.
fn extents(runs: &[Channels]) -> Vec<Extent> {
    let count = runs.first().map_or(0, Vec::len);
    let of = |signal: usize| {
        let all = || runs.iter().flat_map(|signals| &signals[signal]);
        Extent { rms: rms(all()), peak: all().fold(0.0, |peak, x| peak.max(x.abs())) }
    };
    (0..count).map(of).collect()
}

impl BlackBox {
    /// Simulates a new input from rest at `t0`, with the simulation as given and its refit.
    pub(super) fn predict(&self, given: &Plant, refitted: &Plant, u: &[Vec<f64>], t0: f64) -> Channels {
        let plant = if self.of_refit { refitted } else { given };
        let bank = Bank::new(plant);
        let run = run(signals(plant, u), t0, plant.rate, self.end_s);
        let mut y = run.signals[plant.m..plant.m + plant.p].to_vec();
        for term in &self.terms {
            let filtered = bank.filtered(&term.regressor.values(&run, &self.extents));
            for (y, coefficients) in y.iter_mut().zip(&term.coefficients) {
                for (x, coefficient) in filtered.iter().zip(coefficients) {
                    y.iter_mut().zip(x).for_each(|(y, x)| *y += coefficient * x);
                }
            }
        }
        y
    }
}

#[cfg(test)]
mod tests;
