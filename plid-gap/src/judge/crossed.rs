//! The reliability of predictions: free runs of each fitted record by a model that was fitted to the others.

use std::sync::Arc;

use crate::case::record::{Channels, Record};
use crate::effects::Flexible;
use crate::fit::free_run::outputs;
use crate::fit::free_run::run;
use crate::fit::jacobian::OfRecord;
use crate::fit::problem::{Effort, Fit, Jacobian, Problem};
use crate::judge::gap::{self, Blocks, Reach};
use crate::noise::whiten::Whitener;
use crate::plant::Spectrum;
use crate::settings::JudgeSettings;
use crate::simulate::Fineness;

/// The effort of a fit that starts from the fit to all records.
const FROM_ALL: Effort = Effort { steps: 4, gain: 1.0, fineness: Fineness::COARSE };

/// Number of standard deviations about the mean within which a normal variable lies with a probability of 80 %.
const EIGHTY: f64 = 1.28;

/// An expected gap with its interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stated {
    /// The gap.
    pub gap: f64,
    /// Its 80 % interval.
    pub ci80: [f64; 2],
}

impl Stated {
    fn new(gap: f64, scatter: Scatter) -> Self {
        let reach = scatter.reach();
        Self { gap, ci80: [gap / reach, gap * reach] }
    }

    /// Returns the gap with a wider interval if parts of it differ from record to record. Each part has a squared gap
    /// and its relative variance. The parts are independent, so the variances of squared gaps add, and the sum is
    /// taken as log-normal.
    pub fn with_parts(self, parts: impl Iterator<Item = (f64, f64)>) -> Self {
        let Self { gap, ci80: [_, high] } = self;
        let share = |squared: f64| (squared / (gap * gap)).min(1.0);
        let added: f64 = parts.map(|(squared, variance)| share(squared).powi(2) * variance).sum();
        if !(added > 0.0 && gap > 0.0) {
            return self;
        }
        // If a gap has the logarithmic standard deviation s, its square has the relative variance exp(4 s^2) - 1.
        let std = (high / gap).ln() / EIGHTY;
        let reach = (EIGHTY * ((4.0 * std * std).exp() + added).ln().sqrt() / 2.0).exp();
        Self { gap, ci80: [gap / reach, gap * reach] }
    }
}

/// The scatter of the gaps of records about their expected values.
#[derive(Debug, Clone, Copy)]
struct Scatter {
    /// Number of records.
    records: f64,
    /// Number of records to which the prior scatter is equivalent.
    prior: f64,
    /// Sum of the squared logarithms of gap over expected gap, including those of the prior.
    square: f64,
}

impl Scatter {
    fn with(self, off: f64) -> Self {
        Self { records: self.records + 1.0, square: self.square + off * off, ..self }
    }

    /// Returns the factor within which 80 % of the gaps lie above or below the expected one. It includes the
    /// uncertainty of the mean over the records.
    fn reach(self) -> f64 {
        let Self { records, prior, square } = self;
        (EIGHTY * (square / (records + prior) * (1.0 + 1.0 / records.max(1.0))).sqrt()).exp()
    }
}

/// Returns whether held-out records are as loud as the loudest fitted one, and together at least half as long. The end
/// of a record counts with its beginning, through which its free run passes.
pub fn are_like(held_out: &[Record], loudest: &Record, same_level: f64) -> bool {
    let as_loud = held_out.iter().all(|record| same_level * record.level() > loudest.level());
    as_loud && 2 * held_out.iter().map(Record::samples).sum::<usize>() >= loudest.samples()
}

/// Returns whether held-out records have together at least half as many measured samples as the loudest fitted one.
pub fn are_long(held_out: &[Record], loudest: &Record) -> bool {
    2 * held_out.iter().map(Record::measured).sum::<usize>() >= loudest.measured()
}

/// The free runs of all fitted records, each by a model that was fitted to the others.
pub struct Crossed<'p> {
    records: &'p [Record],
    simulated: Vec<Channels>,
    scatter: Scatter,
    /// The reach of a free shape, if one predicts.
    reach: Option<Reach>,
}

impl<'p> Crossed<'p> {
    /// Predicts each fitted record by a model that is fitted to the others. A record that is louder than all others
    /// is predicted part by part, from its other parts as well: the other records do not show how an effect acts at
    /// that level.
    pub fn of(problem: &'p Problem, fit: &Fit, noise: impl Fn(&Record, Vec<Vec<usize>>) -> Whitener) -> Self {
        let records = &problem.records;
        let driven: Vec<usize> = (0..records.len()).filter(|&k| records[k].is_driven()).collect();
        let mut simulated = outputs(problem, &fit.eta, &fit.effects);
        let reach = reach(problem, fit, &simulated);
        let derivatives = problem.derivatives(&problem.nuisance.apply(&problem.plant, &fit.eta));
        for &k in &driven {
            let predicted = if others_are_as_loud(records, k, problem.settings.case.same_level) {
                by_others(problem, fit, &derivatives, k)
            } else {
                by_parts(problem, fit, &derivatives, k, &noise)
            };
            simulated[k] = if predicted.iter().flatten().all(|y| y.is_finite()) {
                predicted
            } else {
                // A free run that diverges predicts nothing.
                records[k].y.iter().map(|y| vec![0.0; y.len()]).collect()
            };
        }
        Self::new(records, simulated, reach, &problem.settings.judge)
    }

    /// Creates the predictions of all records from their runs, each by a model that was fitted to the others.
    pub(crate) fn new(
        records: &'p [Record],
        simulated: Vec<Channels>,
        reach: Option<Reach>,
        settings: &JudgeSettings,
    ) -> Self {
        let driven: Vec<usize> = (0..records.len()).filter(|&k| records[k].is_driven()).collect();
        // The deviation of each record's gap from the gap expected at its level, as a logarithm.
        let off = |k: &usize| {
            let found = Blocks::new(&records[*k].y, &simulated[*k], 0).gap();
            (found / gap::expected(records, &simulated, records[*k].level())).ln()
        };
        let square: f64 = driven.iter().map(off).filter(|x| x.is_finite()).map(|x| x * x).sum();
        let JudgeSettings { prediction_scatter, prediction_records: prior, .. } = *settings;
        let square = square + prediction_scatter * prediction_scatter * prior;
        let scatter = Scatter { records: driven.len() as f64, prior, square };
        Self { records, simulated, scatter, reach }
    }

    /// Returns the gap to expect on a record of a level.
    pub fn at(&self, level: f64) -> Stated {
        Stated::new(gap::expected_within(self.records, &self.simulated, self.reach, level), self.scatter)
    }

    /// Returns the gap to expect on a record of a level, given that the model of all fitted records left the gap
    /// `left` on held-out records. The models behind `at` are fitted to fewer records than the answer, so their gap
    /// is too large if each record contains information that the others lack. The held-out records show by how much.
    /// Beyond the reach of a free shape, the whole correction is uncertain. A gap that is smaller than the one expected
    /// there says nothing about lower levels.
    pub fn in_view_of(&self, held_out: &[Record], left: f64, level: f64) -> Stated {
        let samples: usize = held_out.iter().map(Record::samples).sum();
        let square = |record: &Record| record.samples() as f64 * record.level().powi(2);
        let held_out = (held_out.iter().map(square).sum::<f64>() / samples.max(1) as f64).sqrt();
        let (stated, ratio) = (self.at(level), left / self.at(held_out).gap);
        let unreached = self.reach.is_some_and(|reach| held_out > reach.level);
        if !(ratio.is_finite() && ratio > 0.0) || unreached && ratio < 1.0 {
            return stated;
        }
        Stated::new(ratio * stated.gap, self.scatter.with(ratio.ln()))
    }
}

/// Returns whether another driven record is as loud as this one. Levels whose ratio is below `same_level` count as one
/// level.
pub(crate) fn others_are_as_loud(records: &[Record], record: usize, same_level: f64) -> bool {
    let as_loud = |other: &Record| other.is_driven() && same_level * other.level() > records[record].level();
    records.iter().enumerate().any(|(k, other)| k != record && as_loud(other))
}

/// Returns the reach of a fit, if one of its effects is a curve without a law. `simulated` are its free runs.
fn reach(problem: &Problem, fit: &Fit, simulated: &[Channels]) -> Option<Reach> {
    let same_level = problem.settings.case.same_level;
    let is_curve = fit.effects.iter().any(|placed| Flexible::is_curve(placed.effect));
    is_curve.then(|| Reach::of(&problem.records, simulated, &outputs(problem, &fit.eta, &[]), same_level))
}

/// Returns the free run of a record by the model that is fitted to the other records. The derivatives are those of all
/// records at the fit.
fn by_others(problem: &Problem, fit: &Fit, derivatives: &[Arc<OfRecord>], k: usize) -> Channels {
    let others = problem.without(k);
    let mut of_others = derivatives.to_vec();
    of_others.remove(k);
    let jacobian = Jacobian::of_records(of_others, &others.nuisance.std);
    let fit = others.fit(&jacobian, &fit.eta, &fit.effects, FROM_ALL);
    run(&others.nuisance.apply(&others.plant, &fit.eta), &others.actions(&fit.effects), &problem.records[k])
}

/// Returns the free run of a record, each part by the model that is fitted to its other parts and the other records.
/// The derivatives are those of all records at the fit.
fn by_parts(
    problem: &Problem,
    fit: &Fit,
    derivatives: &[Arc<OfRecord>],
    only: usize,
    noise: &impl Fn(&Record, Vec<Vec<usize>>) -> Whitener,
) -> Channels {
    let record = &problem.records[only];
    let samples = record.samples();
    let mut whole: Channels = record.y.clone();
    let parts = problem.settings.judge.prediction_parts;
    let plant = problem.nuisance.apply(&problem.plant, &fit.eta);
    let spectrum = Spectrum::of(&plant);
    for part in 0..parts {
        let range = samples * part / parts..samples * (part + 1) / parts;
        let mut others = problem.clone();
        for y in &mut others.records[only].y {
            y[range.clone()].fill(f64::NAN);
        }
        // The samples that are missing now are masked as well.
        let whitener = noise(&others.records[only], problem.whiteners[only].masked.clone());
        others.whiteners[only] = whitener;
        let mut of_others = derivatives.to_vec();
        of_others[only] = others.derivatives_of(only, &plant, spectrum.as_ref());
        let jacobian = Jacobian::of_records(of_others, &others.nuisance.std);
        let fit = others.fit(&jacobian, &fit.eta, &fit.effects, FROM_ALL);
        let y = &outputs(&others, &fit.eta, &fit.effects)[only];
        for (to, from) in whole.iter_mut().zip(y) {
            to[range.clone()].copy_from_slice(&from[range.clone()]);
        }
    }
    whole
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{Effect, Place};
    use crate::fit::problem::Placed;
    use crate::fit::refit::refit;
    use crate::prepare::{Known, prepare};
    use crate::testing;

    /// The last quarter of a record is shorter than half of what is fitted, but as loud.
    #[test]
    fn the_end_of_a_record_is_short() {
        let u = testing::random_input(5, 4000, 1);
        let (head, tail) = crate::case::split::divided(&testing::record(u.clone(), u), 3000);
        let ends = std::slice::from_ref(&tail);
        assert!(!are_long(ends, &head) && are_like(ends, &head, 1.5));
        let (head, tail) = crate::case::split::divided(&head, 1500);
        assert!(are_long(&[tail], &head));
    }

    /// If quieter held-out records leave half of the gap that was expected of them, the same is expected of a loud one.
    #[test]
    fn what_quieter_held_out_records_leave_counts_at_their_own_level() {
        let noise = crate::testing::random_input(3, 4000, 1);
        let record = |level: f64, gap: f64| {
            let u: Vec<f64> = (0..4000).map(|k| level * (0.1 * f64::from(k)).sin()).collect();
            let y = u.iter().zip(&noise[0]).map(|(u, e)| u + gap * (0.5_f64).sqrt() * e).collect();
            (crate::testing::record(vec![u.clone()], vec![y]), vec![u])
        };
        // The error has the same size in both records, so it is relatively a fifth as large in the louder one.
        let ((loud, a), (quiet, b)) = (record(1.0, 0.1), record(0.2, 0.1));
        let scatter = Scatter { records: 2.0, prior: 4.0, square: 4.0 * 0.12_f64.powi(2) };
        let crossed = Crossed { records: &[loud.clone(), quiet.clone()], simulated: vec![a, b], scatter, reach: None };
        let before = crossed.at(loud.level());
        assert!((before.gap - 0.1).abs() < 0.01, "{before:?}");
        let expected = crossed.at(quiet.level()).gap;
        assert!(expected > 0.4, "{expected}");
        let stated = crossed.in_view_of(&[quiet], 0.5 * expected, loud.level());
        assert!((stated.gap / before.gap - 0.5).abs() < 1e-12, "{stated:?}");
        // This deviation is so large that the interval becomes wider.
        assert!(stated.ci80[1] / stated.gap > before.ci80[1] / before.gap, "{stated:?} {before:?}");
    }

    /// A louder held-out record, which a curve without a law does not reach, leaves less than the whole correction.
    /// That says nothing about the fitted level. If it leaves more, the stated gap grows.
    #[test]
    fn what_a_curve_leaves_beyond_its_reach_does_not_narrow_the_stated_gap() {
        let [u, error] = [1, 2].map(|seed| testing::random_input(seed, 4000, 1).remove(0));
        let record = |level: f64| {
            let u: Vec<f64> = u.iter().map(|u| level * u).collect();
            let y = u.iter().zip(&error).map(|(u, e)| u + 0.1 * level * e).collect();
            (testing::record(vec![u.clone()], vec![y]), vec![u])
        };
        let ((fitted, simulated), (louder, _)) = (record(1.0), record(3.0));
        let scatter = Scatter { records: 1.0, prior: 4.0, square: 4.0 * 0.12_f64.powi(2) };
        let reach = Some(Reach { level: 1.15 * fitted.level(), correction: 0.3 });
        let records = [fitted.clone()];
        let crossed = |reach| Crossed { records: &records, simulated: vec![simulated.clone()], scatter, reach };
        let (curve, law) = (crossed(reach), crossed(None));
        let level = fitted.level();
        assert!(curve.at(louder.level()).gap > 0.3);
        assert_eq!(curve.at(level), law.at(level));
        let held_out = [louder];
        assert_eq!(curve.in_view_of(&held_out, 0.01, level), curve.at(level));
        assert!(law.in_view_of(&held_out, 0.01, level).gap < 0.5 * law.at(level).gap);
        assert!(curve.in_view_of(&held_out, 0.6, level).gap > 1.5 * curve.at(level).gap);
        // Within the reach, a curve is as good as a law.
        assert_eq!(curve.in_view_of(&records, 0.02, level), law.in_view_of(&records, 0.02, level));
    }

    /// A fit with a free curve has a reach. The weights of a free path hold at any level.
    #[test]
    fn a_free_curve_has_a_reach() {
        let model = testing::truss(1);
        let case = testing::case(&model, &model);
        let problem = prepare(&model, &case.records, &Known::default()).unwrap().problem;
        for (shape, is_curve) in [(Flexible::Sensor, true), (Flexible::SensorPath, false)] {
            let place = Place::Output(0);
            let mut parameters = shape.starts(&problem.setting, &place).remove(0);
            parameters[0] = 0.1;
            let effects = vec![Placed { effect: &shape, place, parameters }];
            let fit = Fit { effects, ..refit(&problem, 0).as_fit() };
            let reach = reach(&problem, &fit, &outputs(&problem, &fit.eta, &fit.effects));
            assert_eq!(reach.is_some_and(|reach| reach.correction > 0.0), is_curve, "{}", shape.name());
        }
    }
}
