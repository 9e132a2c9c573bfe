//! Noise covariances by free-run error over a bank of filters.
//!
//! They matter more than anything else in PLID, and the record itself tells which serve: a filter of the bank is run over the
//! first part of the training data, its model is frozen, and its free-run error on the rest of the training data is its score.
//! The bank is a coarse grid over R and Sigma / R in decades, followed by a descent to the best neighbour.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};

use plid_core::{ImplicitModel, NoiseModel, ObservableForm, Settings};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::recursion::{Ending, Plan, run};
use super::{IdentifyError, Samples, free_run_error};
use plid_catalogue::{CovarianceName, ExpectationName, Variant};

/// What the bank may vary.
#[derive(Clone, Debug)]
pub struct Bank {
    /// The structure.
    pub form: ObservableForm,
    /// Start, forgetting and parameter noise.
    pub settings: Settings,
    /// The expectation that the final run will use.
    pub expectations: ExpectationName,
    /// Variances R_ii where they are known (p); else the bank searches one common variance, in units of the outputs' power.
    pub sensor: Option<Vec<f64>>,
    /// Variances Q_jj (m).
    pub actuator: Vec<f64>,
}

/// One filter of the bank.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Trial {
    /// R_ii, or the factor on the known R.
    pub sensor: f64,
    /// Sigma_ii.
    pub state: f64,
    /// Free-run error on the scoring part, relative; `None` where the filter or its model diverged.
    pub free_run: Option<f64>,
}

/// What the bank found.
#[derive(Clone, Debug)]
pub struct Tuned {
    /// The covariances of the best filter.
    pub noise: NoiseModel,
    /// The best filter.
    pub best: Trial,
    /// Its place on the grid.
    pub point: Point,
    /// All filters, in order of R and Sigma.
    pub trials: Vec<Trial>,
}

/// A point of the grid: log10 of R and of Sigma, in tenths of a decade so that they compare exactly.
pub type Point = (i32, i32);

/// Steps of the descent: a decade, then a third of one.
const DECADE: i32 = 10;
const THIRD: i32 = 3;
/// Below this Sigma_ii plays no part in double precision.
const SMALLEST: i32 = -130;

impl Bank {
    fn value(point: i32) -> f64 {
        10f64.powf(f64::from(point) / 10.0)
    }

    /// The covariances at a point of the grid.
    pub fn noise(&self, point: Point) -> NoiseModel {
        let state = vec![Self::value(point.1); self.form.states()];
        let sensor = match &self.sensor {
            Some(known) => known.clone(),
            None => vec![Self::value(point.0); self.form.outputs()],
        };
        NoiseModel::diagonal(&sensor, &self.actuator, &state)
    }

    /// Where a search begins: a coarse grid, or a column of it where R is known.
    pub fn start(&self) -> Vec<Point> {
        let column = |sensor: i32, ratios: &[i32]| -> Vec<Point> {
            ratios.iter().map(|&ratio| (sensor, (sensor + ratio).max(SMALLEST))).collect()
        };
        match &self.sensor {
            Some(known) => {
                let mean = known.iter().sum::<f64>() / known.len() as f64;
                let level = (10.0 * mean.max(1e-12).log10()).round() as i32;
                column(level, &[0, -10, -20, -30, -40, -50, -60])
            }
            None => [-20, -40, -60].iter().flat_map(|&r| column(r, &[0, -20, -40, -60])).collect(),
        }
    }

    fn neighbours(&self, (sensor, state): Point, step: i32) -> Vec<Point> {
        let mut points = vec![(sensor, state + step), (sensor, (state - step).max(SMALLEST))];
        if self.sensor.is_none() {
            points.extend([(sensor + step, state), (sensor - step, state)]);
        }
        points.retain(|&(r, s)| (-100..=0).contains(&r) && s <= 0);
        points
    }

    /// The recursion with `noise`, as the bank runs it.
    pub fn plan(&self, noise: NoiseModel) -> Plan {
        // The direct form is the fastest; where it breaks down, the setting is too near the edge to be chosen anyway.
        let (covariance, expectations) = (CovarianceName::Direct, self.expectations);
        let variant = Variant { covariance, expectations, ..Variant::default() };
        Plan { form: self.form.clone(), noise, settings: self.settings.clone(), variant, passes: 1 }
    }

    /// The free-run error of the filter with `noise`; infinite where it or its model diverges.
    fn score(&self, noise: NoiseModel, split: &Split<'_>, may_go_on: &(dyn Fn() -> bool + Sync)) -> Option<f64> {
        match run(&self.plan(noise), &split.learn, None, &mut |_, _| may_go_on()) {
            Ok(Ending::Done(run)) => Some(free_run_error(&run.identified, &self.form, split.score)),
            Ok(Ending::Paused(_)) => None,
            Err(_) => Some(f64::INFINITY),
        }
    }
}

/// Training data, of which the last record's tail scores what is learnt from the rest.
pub struct Split<'a> {
    /// What is learnt from.
    pub learn: Vec<Samples<'a>>,
    /// What scores.
    pub score: Samples<'a>,
}

impl<'a> Split<'a> {
    /// The leading `share` of all training samples is learnt from, but at least half of the last record.
    ///
    /// # Panics
    /// Without a record.
    pub fn new(training: &[Samples<'a>], share: f64) -> Self {
        let (last, before) = training.split_last().expect("there is a training record");
        let total: usize = training.iter().map(Samples::len).sum();
        let held = ((1.0 - share) * total as f64) as usize;
        let cut = last.len().saturating_sub(held).max(last.len() / 2);
        let learn = before.iter().copied().chain([last.range(0, cut)]).collect();
        Self { learn, score: last.range(cut, last.len()) }
    }
}

/// Scores already known, by indices and point: what an interrupted run need not do again.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Memory(Vec<(Vec<usize>, Point, Option<f64>)>);

impl Memory {
    fn find(&self, indices: &[usize], point: Point) -> Option<f64> {
        let entry = self.0.iter().find(|(i, p, _)| i == indices && *p == point)?;
        Some(entry.2.unwrap_or(f64::INFINITY))
    }

    fn store(&mut self, indices: &[usize], point: Point, error: f64) {
        self.0.push((indices.to_vec(), point, error.is_finite().then_some(error)));
    }
}

/// What a search over filters is told and asked.
pub struct Search<'a> {
    /// Training data.
    pub split: Split<'a>,
    /// Told of filters done and planned.
    pub progress: &'a (dyn Fn(usize, usize) + Sync),
    /// Whether to go on.
    pub may_go_on: &'a (dyn Fn() -> bool + Sync),
    /// What is known already.
    pub memory: Memory,
}

/// Finds the noise covariances with which PLID's model simulates best.
///
/// # Errors
/// [`IdentifyError::NoSetting`] if every filter or its model diverged, [`IdentifyError::Interrupted`].
pub fn tune(bank: &Bank, search: &mut Search<'_>) -> Result<Tuned, IdentifyError> {
    let Search { split, progress, may_go_on, memory } = search;
    tune_by(bank, bank.start(), *progress, memory, &|point| bank.score(bank.noise(point), split, *may_go_on))
}

/// The same from any points of the grid of `bank` and by any score: a free-run error, infinite for none, or `None` where the user has asked for an end.
///
/// # Errors
/// As [`tune`].
pub fn tune_by(
    bank: &Bank,
    start: Vec<Point>,
    progress: &(dyn Fn(usize, usize) + Sync),
    memory: &mut Memory,
    score: &(dyn Fn(Point) -> Option<f64> + Sync),
) -> Result<Tuned, IdentifyError> {
    let indices = bank.form.indices().to_vec();
    let mut scores: BTreeMap<Point, f64> = BTreeMap::new();
    let mut evaluate = |points: Vec<Point>, scores: &mut BTreeMap<Point, f64>| -> Result<(), IdentifyError> {
        let mut new = Vec::new();
        for point in points {
            if scores.contains_key(&point) || new.contains(&point) {
                continue;
            }
            match memory.find(&indices, point) {
                Some(error) => drop(scores.insert(point, error)),
                None => new.push(point),
            }
        }
        let done = AtomicUsize::new(scores.len());
        let planned = scores.len() + new.len();
        let results: Vec<(Point, Option<f64>)> = new
            .par_iter()
            .map(|&point| {
                let score = score(point);
                progress(done.fetch_add(1, Ordering::Relaxed) + 1, planned);
                (point, score)
            })
            .collect();
        let mut interrupted = false;
        for (point, score) in results {
            match score {
                Some(error) => {
                    memory.store(&indices, point, error);
                    scores.insert(point, error);
                }
                None => interrupted = true,
            }
        }
        if interrupted { Err(IdentifyError::Interrupted) } else { Ok(()) }
    };
    // Ties, as between two infinities, go to the larger Sigma: it forgets a poor start sooner.
    let best = |scores: &BTreeMap<Point, f64>| -> (Point, f64) {
        scores
            .iter()
            .map(|(&point, &error)| (point, error))
            .min_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)))
            .expect("the grid is not empty")
    };
    evaluate(start, &mut scores)?;
    let mut step = DECADE;
    for _ in 0..12 {
        let before = best(&scores);
        evaluate(bank.neighbours(before.0, step), &mut scores)?;
        // Half a per cent is less than what another record would change.
        if best(&scores).1 > 0.995 * before.1 {
            if step == THIRD {
                break;
            }
            step = THIRD;
        }
    }
    let (point, error) = best(&scores);
    if !error.is_finite() {
        return Err(IdentifyError::NoSetting { trials: scores.len() });
    }
    let trial = |(point, error): (Point, f64)| Trial {
        sensor: Bank::value(point.0),
        state: Bank::value(point.1),
        free_run: error.is_finite().then_some(error),
    };
    let trials = scores.into_iter().map(trial).collect();
    Ok(Tuned { noise: bank.noise(point), best: trial((point, error)), point, trials })
}
