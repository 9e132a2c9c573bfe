//! The reliability of predictions: free runs of each fitted record by a model of the others.

use crate::case::record::{Channels, Record};
use crate::fit::free_run::outputs;
use crate::fit::free_run::run;
use crate::fit::problem::{Effort, Fit, Problem};
use crate::judge::gap::{self, Blocks};
use crate::noise::whiten::Whitener;
use crate::settings::JudgeSettings;
use crate::simulate::Fineness;

/// A fit that starts from the fit to all records.
const FROM_ALL: Effort = Effort { steps: 4, gain: 1.0, fineness: Fineness::COARSE };

/// An expected gap with its basis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stated {
    /// The gap.
    pub gap: f64,
    /// Its 80 % interval.
    pub ci80: [f64; 2],
}

impl Stated {
    /// Returns the gap to expect after records that no fit has seen were predicted by all fitted ones, and left this
    /// gap. It takes the place of the gap stated before: that one comes from models of fewer records than the answer is
    /// fitted to, so that it is too large where each record shows something of its own. The relative width of the
    /// interval, the scatter from record to record, stays.
    pub fn after(self, held_out: f64) -> Self {
        let change = held_out / self.gap;
        if !(change.is_finite() && change > 0.0) {
            return self;
        }
        Self { gap: held_out, ci80: self.ci80.map(|end| change * end) }
    }
}

/// Returns whether held-out records show what to expect of a record like the loudest fitted one: they are as loud, and
/// together at least half as long.
pub fn are_like(held_out: &[Record], loudest: &Record, same_level: f64) -> bool {
    let as_loud = |record: &&Record| same_level * record.level() > loudest.level();
    let samples: usize = held_out.iter().filter(as_loud).map(Record::samples).sum();
    held_out.iter().all(|record| as_loud(&record)) && 2 * samples >= loudest.samples()
}

/// Returns the gap to expect on a record of a level, from the prediction of each fitted record by a model of the
/// others. A record that is louder than all others is predicted part by part, from its other parts as well: what an
/// effect does at that level cannot be told from the other records.
pub fn stated(problem: &Problem, fit: &Fit, level: f64, noise: impl Fn(&Record) -> Whitener) -> Stated {
    let records = &problem.records;
    let driven: Vec<usize> = (0..records.len()).filter(|&k| records[k].is_driven()).collect();
    let mut simulated = outputs(problem, &fit.eta, &fit.effects);
    let same_level = problem.settings.case.same_level;
    for &k in &driven {
        let as_loud = |other: &&usize| **other != k && same_level * records[**other].level() > records[k].level();
        let predicted = if driven.iter().any(|other| as_loud(&other)) {
            by_others(problem, fit, k)
        } else {
            by_parts(problem, fit, k, &noise)
        };
        simulated[k] = if predicted.iter().flatten().all(|y| y.is_finite()) {
            predicted
        } else {
            // A free run that diverges predicts nothing.
            records[k].y.iter().map(|y| vec![0.0; y.len()]).collect()
        };
    }
    let gap = gap::expected(records, &simulated, level);
    // The deviation of each record's gap from that of its level, as a logarithm.
    let off = |k: &usize| {
        let found = Blocks::new(&records[*k].y, &simulated[*k], 0).gap();
        (found / gap::expected(records, &simulated, records[*k].level())).ln()
    };
    let square: f64 = driven.iter().map(off).filter(|x| x.is_finite()).map(|x| x * x).sum();
    let JudgeSettings { prediction_scatter, prediction_records, .. } = problem.settings.judge;
    let known = prediction_scatter * prediction_scatter * prediction_records;
    let count = driven.len() as f64;
    let scatter = ((square + known) / (count + prediction_records) * (1.0 + 1.0 / count.max(1.0))).sqrt();
    // 80 % of a normal variable lie within 1.28 standard deviations.
    let reach = (1.28 * scatter).exp();
    Stated { gap, ci80: [gap / reach, gap * reach] }
}

/// Returns the free run of a record by the model of the others.
fn by_others(problem: &Problem, fit: &Fit, k: usize) -> Channels {
    let others = problem.without(k);
    let jacobian = others.jacobian(&others.nuisance.apply(&others.plant, &fit.eta));
    let fit = others.fit(&jacobian, &fit.eta, &fit.effects, FROM_ALL);
    run(&others.nuisance.apply(&others.plant, &fit.eta), &others.actions(&fit.effects), &problem.records[k])
}

/// Returns the free run of a record, each part by the model of its other parts and of the other records.
fn by_parts(problem: &Problem, fit: &Fit, only: usize, noise: &impl Fn(&Record) -> Whitener) -> Channels {
    let record = &problem.records[only];
    let samples = record.samples();
    let mut whole: Channels = record.y.clone();
    let parts = problem.settings.judge.prediction_parts;
    for part in 0..parts {
        let range = samples * part / parts..samples * (part + 1) / parts;
        let mut others = problem.clone();
        for y in &mut others.records[only].y {
            y[range.clone()].fill(f64::NAN);
        }
        let mut whitener = noise(record);
        for (masked, known) in whitener.masked.iter_mut().zip(&problem.whiteners[only].masked) {
            masked.clone_from(known);
            masked.extend(range.clone());
        }
        others.whiteners[only] = whitener;
        let jacobian = others.jacobian(&others.nuisance.apply(&others.plant, &fit.eta));
        let fit = others.fit(&jacobian, &fit.eta, &fit.effects, FROM_ALL);
        let y = &outputs(&others, &fit.eta, &fit.effects)[only];
        for (to, from) in whole.iter_mut().zip(y) {
            to[range.clone()].copy_from_slice(&from[range.clone()]);
        }
    }
    whole
}
