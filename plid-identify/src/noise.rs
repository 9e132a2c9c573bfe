//! Selection of the noise covariances by simulation error over a bank of filters.
//!
//! The noise covariances matter more than any other setting of PLID, and the record itself determines which are best.
//! Each filter of the bank is run over the first part of the training data. Its model is then fixed, and the model's
//! simulation error on the rest of the training data is the filter's score. The bank is a coarse grid over R and Sigma
//! / R in decades, followed by a descent to the best neighbour.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};

use plid_core::{IdentifiedModel, ImplicitModel, NoiseModel, ObservableForm, Settings};
use serde::{Deserialize, Serialize};

use super::recursion::{Course, Plan};
use super::{IdentifyError, Samples, free_run_error};
use plid_catalogue::{CovarianceName, ExpectationName, Variant};

/// The fixed settings of a filter bank.
#[derive(Clone, Debug)]
pub struct Bank {
    /// The observable canonical form.
    pub form: ObservableForm,
    /// Initial estimate, forgetting and parameter noise.
    pub settings: Settings,
    /// The conditional expectation that the final run will use.
    pub expectations: ExpectationName,
    /// Known variances R_ii (p). If `None`, the bank searches for one common variance, in units of the outputs' power.
    pub sensor: Option<Vec<f64>>,
    /// Variances Q_jj (m).
    pub actuator: Vec<f64>,
}

/// One filter of the bank and its score.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Trial {
    /// The variance R_ii. If R is known, this is the mean of its diagonal, rounded to a tenth of a decade.
    pub sensor: f64,
    /// The variance Sigma_ii.
    pub state: f64,
    /// Relative simulation error on the scoring data; `None` if the filter or its model diverged.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub free_run: Option<f64>,
}

/// The result of the filter bank.
#[derive(Clone, Debug)]
pub struct Tuned {
    /// The covariances of the best filter.
    pub noise: NoiseModel,
    /// The best filter.
    pub best: Trial,
    /// The grid point of the best filter.
    pub point: Point,
    /// All filters in order of R and Sigma.
    pub trials: Vec<Trial>,
}

/// A point of the grid: log10 of R and of Sigma in tenths of a decade, as integers so that points compare exactly.
pub type Point = (i32, i32);

/// Step sizes of the descent in tenths of a decade: one decade, then a third of one.
const DECADE: i32 = 10;
const THIRD: i32 = 3;
/// The exponent of Sigma_ii, in tenths of a decade, below which Sigma_ii has no effect in double precision.
const SMALLEST: i32 = -130;

impl Bank {
    fn value(point: i32) -> f64 {
        10f64.powf(f64::from(point) / 10.0)
    }

    /// Returns the covariances at a point of the grid.
    pub fn noise(&self, point: Point) -> NoiseModel {
        let state = vec![Self::value(point.1); self.form.states()];
        let sensor = match &self.sensor {
            Some(known) => known.clone(),
            None => vec![Self::value(point.0); self.form.outputs()],
        };
        NoiseModel::diagonal(&sensor, &self.actuator, &state)
    }

    /// Returns the initial points of a search: a coarse grid, or a column of it if R is known.
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

    /// Returns the recursion with `noise`, as the bank runs it.
    pub fn plan(&self, noise: NoiseModel) -> Plan {
        // The direct form is the fastest. A setting for which this form fails is too close to the stability limit to
        // be selected.
        let (covariance, expectations) = (CovarianceName::Direct, self.expectations);
        let variant = Variant { covariance, expectations, ..Variant::default() };
        Plan { form: self.form.clone(), noise, settings: self.settings.clone(), variant, passes: 1 }
    }

    /// Returns the simulation error of the filter with `noise`; infinite if the filter or its model diverges, and
    /// `None` if the run was interrupted.
    fn score(&self, noise: NoiseModel, split: &Split<'_>, may_go_on: &(dyn Fn() -> bool + Sync)) -> Option<f64> {
        match identified(&self.plan(noise), &split.learn, may_go_on) {
            Ok(Some(model)) => Some(free_run_error(&model, &self.form, split.score)),
            Ok(None) => None,
            Err(_) => Some(f64::INFINITY),
        }
    }
}

/// Runs the recursion as [`super::run`] does, but does not keep the innovations, because those of many filters would
/// fill the memory. Returns `None` if the run was interrupted.
fn identified(
    plan: &Plan,
    records: &[Samples<'_>],
    may_go_on: &(dyn Fn() -> bool + Sync),
) -> Result<Option<IdentifiedModel>, IdentifyError> {
    let mut course = Course::start(plan)?;
    for (number, record) in records.iter().enumerate() {
        if number > 0 {
            course.next_record()?;
        }
        for (outputs, inputs) in record.outputs.rows().into_iter().zip(record.inputs.rows()) {
            course.step(outputs, inputs, record.nan_is_missing)?;
            if !may_go_on() {
                return Ok(None);
            }
        }
    }
    Ok(Some(course.finish(Vec::new()).identified))
}

/// Training data divided into a part for the filters and a part of the last record that scores them.
pub struct Split<'a> {
    /// The part on which the filters run.
    pub learn: Vec<Samples<'a>>,
    /// The part that scores their models.
    pub score: Samples<'a>,
}

impl<'a> Split<'a> {
    /// Divides the training data: the filters run over the leading fraction `share` of all samples, but at least half
    /// of the last record.
    ///
    /// # Panics
    /// Panics if there is no record.
    pub fn new(training: &[Samples<'a>], share: f64) -> Self {
        let (last, before) = training.split_last().expect("there is a training record");
        let total: usize = training.iter().map(Samples::len).sum();
        let held = ((1.0 - share) * total as f64) as usize;
        let cut = last.len().saturating_sub(held).max(last.len() / 2);
        let learn = before.iter().copied().chain([last.range(0, cut)]).collect();
        Self { learn, score: last.range(cut, last.len()) }
    }
}

/// Known scores by indices and grid point, so that a resumed search does not compute them again.
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

/// The data, progress callbacks and known scores of a search over filters.
pub struct Search<'a> {
    /// The training data.
    pub split: Split<'a>,
    /// Receives the numbers of filters done and planned.
    pub progress: &'a (dyn Fn(usize, usize) + Sync),
    /// Returns whether to continue.
    pub may_go_on: &'a (dyn Fn() -> bool + Sync),
    /// The scores already known.
    pub memory: Memory,
}

/// Finds the noise covariances that give the model with the smallest simulation error.
///
/// # Errors
/// Returns [`IdentifyError::NoSetting`] if every filter or its model diverged, or [`IdentifyError::Interrupted`].
pub fn tune(bank: &Bank, search: &mut Search<'_>) -> Result<Tuned, IdentifyError> {
    let Search { split, progress, may_go_on, memory } = search;
    tune_by(bank, bank.start(), *progress, memory, &|point| bank.score(bank.noise(point), split, *may_go_on))
}

/// Scores each point once and stores the score.
struct Evaluator<'a> {
    /// The observability indices for which the scores hold.
    indices: Vec<usize>,
    progress: &'a (dyn Fn(usize, usize) + Sync),
    memory: &'a mut Memory,
    score: &'a (dyn Fn(Point) -> Option<f64> + Sync),
}

impl Evaluator<'_> {
    /// Scores the points that have no score yet.
    fn add(&mut self, points: Vec<Point>, scores: &mut BTreeMap<Point, f64>) -> Result<(), IdentifyError> {
        let mut new = Vec::new();
        for point in points {
            if scores.contains_key(&point) || new.contains(&point) {
                continue;
            }
            match self.memory.find(&self.indices, point) {
                Some(error) => drop(scores.insert(point, error)),
                None => new.push(point),
            }
        }
        let done = AtomicUsize::new(scores.len());
        let planned = scores.len() + new.len();
        let (progress, score) = (self.progress, self.score);
        let results = for_each_point(&new, &|point| {
            let score = score(point);
            progress(done.fetch_add(1, Ordering::Relaxed) + 1, planned);
            score
        });
        let mut interrupted = false;
        for (&point, score) in new.iter().zip(results) {
            match score {
                Some(error) => {
                    self.memory.store(&self.indices, point, error);
                    scores.insert(point, error);
                }
                None => interrupted = true,
            }
        }
        if interrupted { Err(IdentifyError::Interrupted) } else { Ok(()) }
    }
}

/// Searches from any points of the grid of `bank` with any score. The score is a simulation error, which is infinite
/// if there is no model, or `None` if the user requested an interruption.
///
/// # Errors
/// Returns the errors of [`tune`].
pub fn tune_by(
    bank: &Bank,
    start: Vec<Point>,
    progress: &(dyn Fn(usize, usize) + Sync),
    memory: &mut Memory,
    score: &(dyn Fn(Point) -> Option<f64> + Sync),
) -> Result<Tuned, IdentifyError> {
    let mut scores: BTreeMap<Point, f64> = BTreeMap::new();
    let mut evaluator = Evaluator { indices: bank.form.indices().to_vec(), progress, memory, score };
    // Ties, such as two infinite errors, are resolved in favour of the larger R and, for equal R, of the larger Sigma,
    // with which the filter forgets a poor initial estimate sooner.
    let best = |scores: &BTreeMap<Point, f64>| -> (Point, f64) {
        scores
            .iter()
            .map(|(&point, &error)| (point, error))
            .min_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)))
            .expect("the grid is not empty")
    };
    evaluator.add(start, &mut scores)?;
    let mut step = DECADE;
    for _ in 0..12 {
        let before = best(&scores);
        evaluator.add(bank.neighbours(before.0, step), &mut scores)?;
        // Half a per cent is less than the variation between records.
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

/// Scores all points: on all cores with the feature `threads`, otherwise one after the other.
fn for_each_point(points: &[Point], score: &(dyn Fn(Point) -> Option<f64> + Sync)) -> Vec<Option<f64>> {
    #[cfg(feature = "threads")]
    {
        use rayon::prelude::*;
        points.par_iter().map(|&point| score(point)).collect()
    }
    #[cfg(not(feature = "threads"))]
    points.iter().map(|&point| score(point)).collect()
}
