//! Noise covariances by free-run error over a bank of filters.
//!
//! They matter more than anything else in PLID, and the record itself tells which serve: a filter of the bank is run over the
//! first part of the training data, its model is frozen, and its free-run error on the rest of the training data is its score.
//! The bank is a coarse grid over R and Sigma / R in decades, followed by a descent to the best neighbour.

use std::collections::BTreeMap;

use plid_core::{ImplicitModel, NoiseModel, ObservableForm, Settings};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::recursion::{Plan, Unwatched, run};
use super::{IdentifyError, Samples, free_run_error};
use crate::variant::{ExpectationName, Variant};

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
    /// The share of the training data that the filters learn from; the rest scores them.
    pub learn: f64,
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
    /// All filters, in order of R and Sigma.
    pub trials: Vec<Trial>,
}

/// A point of the grid: log10 of R and of Sigma, in tenths of a decade so that they compare exactly.
type Point = (i32, i32);

/// Steps of the descent: a decade, then a third of one.
const DECADE: i32 = 10;
const THIRD: i32 = 3;
/// Below this Sigma_ii plays no part in double precision.
const SMALLEST: i32 = -130;

impl Bank {
    fn value(point: i32) -> f64 {
        10f64.powf(f64::from(point) / 10.0)
    }

    fn noise(&self, point: Point) -> NoiseModel {
        let state = vec![Self::value(point.1); self.form.states()];
        let sensor = match &self.sensor {
            Some(known) => known.clone(),
            None => vec![Self::value(point.0); self.form.outputs()],
        };
        NoiseModel::diagonal(&sensor, &self.actuator, &state)
    }

    fn start(&self) -> Vec<Point> {
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

    fn score(&self, point: Point, learn: Samples<'_>, score: Samples<'_>) -> Result<f64, String> {
        // The forms agree to rounding; the direct one is the fastest.
        let variant = Variant { expectations: self.expectations, ..Variant::default() };
        let (form, noise, settings) = (self.form.clone(), self.noise(point), self.settings.clone());
        let plan = Plan { form, noise, settings, variant, passes: 1 };
        let run = run(&plan, learn, &mut Unwatched).map_err(|e| e.to_string())?;
        Ok(free_run_error(&run.identified, &self.form, score))
    }
}

/// Finds the noise covariances with which PLID's model simulates best. `progress` is told of each filter done, and of those planned so far.
///
/// # Errors
/// [`IdentifyError::NoSetting`] if every filter or its model diverged.
pub fn tune(
    bank: &Bank,
    training: Samples<'_>,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Tuned, IdentifyError> {
    let cut = (training.len() as f64 * bank.learn) as usize;
    let (learn, score) = (training.range(0, cut), training.range(cut, training.len()));
    let mut scores: BTreeMap<Point, f64> = BTreeMap::new();
    let mut last = String::from("free-run simulation diverged");
    let mut evaluate = |points: Vec<Point>, scores: &mut BTreeMap<Point, f64>| {
        let new: Vec<Point> = points.into_iter().filter(|p| !scores.contains_key(p)).collect();
        let before = scores.len();
        let planned = before + new.len();
        let done = std::sync::atomic::AtomicUsize::new(before);
        let results: Vec<_> = new
            .par_iter()
            .map(|&point| {
                let result = bank.score(point, learn, score);
                let count = done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1;
                progress(count, planned);
                (point, result)
            })
            .collect();
        for (point, result) in results {
            let error = result.unwrap_or_else(|reason| {
                last = reason;
                f64::INFINITY
            });
            scores.insert(point, error);
        }
    };
    // Ties, as between two infinities, go to the larger Sigma: it forgets a poor start sooner.
    let best = |scores: &BTreeMap<Point, f64>| -> (Point, f64) {
        scores
            .iter()
            .map(|(&point, &error)| (point, error))
            .min_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)))
            .expect("the grid is not empty")
    };
    evaluate(bank.start(), &mut scores);
    let mut step = DECADE;
    for _ in 0..12 {
        let before = best(&scores);
        evaluate(bank.neighbours(before.0, step), &mut scores);
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
        return Err(IdentifyError::NoSetting { trials: scores.len(), last });
    }
    let trial = |(point, error): (Point, f64)| Trial {
        sensor: Bank::value(point.0),
        state: Bank::value(point.1),
        free_run: error.is_finite().then_some(error),
    };
    Ok(Tuned { noise: bank.noise(point), best: trial((point, error)), trials: scores.into_iter().map(trial).collect() })
}
