//! The ablation of statistics: which of those that answers record separates right causes from wrong ones best.
//!
//! The question is whether the first effect of an answer is at work, at its place. If the verdict is "unknown", it is
//! the first effect of the explanation that comes nearest. Each statistic predicts the outcome by a logistic
//! regression, alone and beside the present basis of the probability, and all figures are cross-validated. The tails
//! of the statistics differ by orders of magnitude, so each enters by its rank among the answers that are fitted.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{DMatrix, DVector};
use plid_gap::answer::schema::About;
use plid_gap::calibration::{MOST_LOG_ODDS, log_odds};
use serde::Serialize;

use super::regression::{PRIOR, newton};
use super::{PARTS, basis};
use crate::statistics::{auc, brier, log_loss};

/// The name of the row of the present basis.
pub const PRESENT: &str = "present basis";

/// The name of the row that knows only how often first effects are right.
pub const FREQUENCY: &str = "frequency alone";

/// The statistics of an answer, and whether its first effect was right.
#[derive(Debug, Clone, PartialEq)]
pub struct Observed {
    /// The trial.
    pub trial: String,
    /// The case. A second answer to it is not independent.
    pub case: String,
    /// The probability of the first effect before calibration.
    pub before: f64,
    /// The present basis.
    pub basis: BTreeMap<String, f64>,
    /// The statistics.
    pub values: BTreeMap<String, f64>,
    /// Whether the first effect is at work, at its place.
    pub right: bool,
}

/// How well cross-validated probabilities agree with the outcomes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Figures {
    /// The Brier score.
    pub brier: f64,
    /// The logarithmic loss: the mean of -ln of the probability of what came true.
    pub log_loss: f64,
    /// The area under the receiver operating characteristic. `None` if all outcomes are equal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub auc: Option<f64>,
    /// The Brier score of the present basis minus this one, and the standard error of the difference.
    pub gain: [f64; 2],
}

/// A row of the table.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Separation {
    /// The name of the statistic.
    pub statistic: String,
    /// Number of answers that record it. The others count as if it were in the middle of its range.
    pub answers: usize,
    /// Number of all answers, on which the figures rest.
    pub of: usize,
    /// The figures of the statistic alone.
    pub alone: Figures,
    /// The figures of the statistic beside the present basis.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub beside: Option<Figures>,
}

/// The quantities of a regression.
#[derive(Clone, Copy)]
struct Quantities<'s> {
    present: bool,
    statistic: Option<&'s str>,
}

impl Quantities<'_> {
    /// Returns the quantities of an answer. `sorted` are the values of the statistic in the answers that are fitted.
    fn of(&self, one: &Observed, sorted: &[f64]) -> Vec<f64> {
        let mut row = vec![1.0];
        if self.present {
            row.push(log_odds(one.before));
            row.extend(basis(About::Effect).iter().map(|name| one.basis.get(*name).copied().unwrap_or(0.0)));
        }
        row.extend(self.statistic.map(|name| one.values.get(name).map_or(0.0, |value| rank(*value, sorted))));
        row
    }

    /// Returns the mean and the precision of the prior of the weights: that of the calibration.
    fn prior(&self, columns: usize) -> (DVector<f64>, DVector<f64>) {
        let is_before = |column: usize| self.present && column == 1;
        let std = |column: usize| if column == 0 { PRIOR[0] } else { PRIOR[if is_before(column) { 1 } else { 2 }] };
        (
            DVector::from_fn(columns, |column, _| f64::from(u8::from(is_before(column)))),
            DVector::from_fn(columns, |column, _| std(column).powi(-2)),
        )
    }

    /// Returns the probability of each answer, from a regression on the answers of the other parts.
    fn predicted(&self, observed: &[Observed], parts: &[usize]) -> Vec<f64> {
        let mut predicted = vec![0.5; observed.len()];
        for part in parts.iter().collect::<BTreeSet<_>>() {
            let fitted: Vec<&Observed> =
                (observed.iter().zip(parts)).filter(|(_, p)| *p != part).map(|x| x.0).collect();
            let value = |one: &&Observed| self.statistic.and_then(|name| one.values.get(name)).copied();
            let mut sorted: Vec<f64> = fitted.iter().filter_map(value).collect();
            sorted.sort_by(f64::total_cmp);
            let rows: Vec<Vec<f64>> = fitted.iter().map(|one| self.of(one, &sorted)).collect();
            let columns = self.of(&observed[0], &sorted).len();
            let x = DMatrix::from_row_iterator(rows.len(), columns, rows.into_iter().flatten());
            let right = DVector::from_iterator(fitted.len(), fitted.iter().map(|one| f64::from(u8::from(one.right))));
            let (mean, precision) = self.prior(columns);
            let weights = newton(&x, &right, &mean, &precision);
            for (k, one) in observed.iter().enumerate().filter(|(k, _)| parts[*k] == *part) {
                let odds: f64 = self.of(one, &sorted).iter().zip(weights.iter()).map(|(x, w)| x * w).sum();
                predicted[k] = 1.0 / (1.0 + (-odds.clamp(-MOST_LOG_ODDS, MOST_LOG_ODDS)).exp());
            }
        }
        predicted
    }
}

/// Returns the table: the frequency alone, the present basis, and each statistic, the lowest Brier score first; empty
/// without answers that record statistics.
pub(crate) fn separation(observed: &[Observed]) -> Vec<Separation> {
    if observed.is_empty() {
        return Vec::new();
    }
    let parts = parts(observed);
    let predicted = |present: bool, statistic: Option<&str>| {
        let quantities = Quantities { present, statistic };
        let p = quantities.predicted(observed, &parts);
        p.into_iter().zip(observed).map(|(p, one)| (p, one.right)).collect::<Vec<(f64, bool)>>()
    };
    let present = predicted(true, None);
    let of = |stated: &[(f64, bool)]| figures(stated, &present);
    let row = |statistic: &str, answers: usize, alone: &[(f64, bool)], beside: Option<Figures>| Separation {
        statistic: statistic.to_owned(),
        answers,
        of: observed.len(),
        alone: of(alone),
        beside,
    };
    let names: BTreeSet<&String> = observed.iter().flat_map(|one| one.values.keys()).collect();
    let count = |name: &str| observed.iter().filter(|one| one.values.contains_key(name)).count();
    let statistic = |name: &&String| {
        let beside = of(&predicted(true, Some(name)));
        row(name, count(name), &predicted(false, Some(name)), Some(beside))
    };
    let mut rows: Vec<Separation> = names.iter().map(statistic).collect();
    rows.sort_by(|a, b| a.alone.brier.total_cmp(&b.alone.brier));
    let all = observed.len();
    let first = [row(FREQUENCY, all, &predicted(false, None), None), row(PRESENT, all, &present, None)];
    first.into_iter().chain(rows).collect()
}

/// Returns the table as CSV.
pub(crate) fn csv(rows: &[Separation]) -> String {
    let columns = |figures: Option<&Figures>| -> String {
        let Some(Figures { brier, log_loss, auc, gain: [gain, error] }) = figures else { return ",,,,".to_owned() };
        let auc = auc.map_or(String::new(), |auc| auc.to_string());
        format!("{brier},{log_loss},{auc},{gain},{error}")
    };
    let of = |prefix: &str| {
        ["brier", "log_loss", "auc", "brier_gain", "brier_gain_error"].map(|name| format!("{prefix}{name}")).join(",")
    };
    let mut text = format!("statistic,answers,of,{},{}\n", of(""), of("beside_"));
    for row in rows {
        let Separation { statistic, answers, of, alone, beside } = row;
        text += &format!("{statistic},{answers},{of},{},{}\n", columns(Some(alone)), columns(beside.as_ref()));
    }
    text
}

/// Returns the part of each answer: its trial if there are several, so that none is predicted by its own trial, and
/// otherwise one of [`PARTS`] parts of the cases.
fn parts(observed: &[Observed]) -> Vec<usize> {
    let index = |all: BTreeSet<&String>, of: &dyn Fn(&Observed) -> String| -> Vec<usize> {
        observed.iter().map(|one| all.iter().position(|name| **name == of(one)).unwrap_or(0)).collect()
    };
    let trials: BTreeSet<&String> = observed.iter().map(|one| &one.trial).collect();
    if trials.len() > 1 {
        return index(trials, &|one| one.trial.clone());
    }
    let cases = index(observed.iter().map(|one| &one.case).collect(), &|one| one.case.clone());
    cases.into_iter().map(|case| case % PARTS).collect()
}

/// Returns the position of a value among sorted ones, from -1 to 1.
fn rank(value: f64, sorted: &[f64]) -> f64 {
    let (below, most) = (sorted.partition_point(|x| *x < value), sorted.partition_point(|x| *x <= value));
    if sorted.is_empty() { 0.0 } else { (below + most) as f64 / sorted.len() as f64 - 1.0 }
}

/// Returns the figures of probabilities, compared with those of the present basis for the same answers.
fn figures(stated: &[(f64, bool)], present: &[(f64, bool)]) -> Figures {
    let square = |(p, right): &(f64, bool)| (p - f64::from(u8::from(*right))).powi(2);
    let gains: Vec<f64> = present.iter().zip(stated).map(|(before, after)| square(before) - square(after)).collect();
    let count = gains.len() as f64;
    let mean = gains.iter().sum::<f64>() / count;
    let variance = gains.iter().map(|gain| (gain - mean).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
    Figures {
        brier: brier(stated).unwrap_or(0.0),
        log_loss: log_loss(stated).unwrap_or(0.0),
        auc: auc(stated),
        gain: [mean, (variance / count).sqrt()],
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    /// Returns made-up answers of two kinds of statistics: the share that is left is small if the first effect is
    /// right, and the other one says nothing. Some answers do not record the share.
    fn made_up(trials: usize) -> Vec<Observed> {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let one = |k: usize| {
            let right = rng.random_range(0.0..1.0) < 0.6;
            let left = rng.random_range(0.0..0.6) + if right { 0.0 } else { 0.4 };
            let mut values = BTreeMap::from([("noise".to_owned(), rng.random_range(0.0..1e6))]);
            if !k.is_multiple_of(10) {
                values.insert("left".to_owned(), left);
            }
            let (trial, case) = ((k % trials).to_string(), format!("case-{k}"));
            Observed { trial, case, before: 0.7, basis: BTreeMap::new(), values, right }
        };
        (0..300).map(one).collect()
    }

    #[test]
    fn the_statistic_that_separates_is_first() {
        for trials in [1, 3] {
            let rows = separation(&made_up(trials));
            let names: Vec<&str> = rows.iter().map(|row| row.statistic.as_str()).collect();
            assert_eq!(names, [FREQUENCY, PRESENT, "left", "noise"]);
            let [_, present, left, noise] = rows.as_slice() else { panic!("{rows:?}") };
            assert_eq!((left.answers, left.of, noise.answers), (270, 300, 300));
            assert!(left.alone.auc.unwrap() > 0.85 && noise.alone.auc.unwrap() < 0.6, "{rows:?}");
            let [gain, error] = left.beside.unwrap().gain;
            assert!(gain > 5.0 * error && noise.beside.unwrap().gain[0] < 0.01, "{rows:?}");
            assert_eq!(present.alone.gain, [0.0, 0.0]);
            // The present basis of these answers is the same for all, so it knows only the frequency.
            let right = made_up(trials).iter().filter(|one| one.right).count() as f64 / 300.0;
            assert!((present.alone.brier - right * (1.0 - right)).abs() < 0.01, "{rows:?}");
            assert_eq!(csv(&rows).lines().count(), 5);
            assert!(csv(&rows).lines().all(|line| line.split(',').count() == 13), "{}", csv(&rows));
        }
        assert_eq!(separation(&[]), []);
    }

    /// A second answer to a case is in its part, and no trial predicts itself.
    #[test]
    fn an_answer_is_not_predicted_by_its_own_case_or_trial() {
        let of = |trial: &str, case: &str| {
            let (trial, case) = (trial.to_owned(), case.to_owned());
            Observed { trial, case, before: 0.5, basis: BTreeMap::new(), values: BTreeMap::new(), right: true }
        };
        assert_eq!(parts(&[of("a", "1"), of("a", "1"), of("a", "2")]), [0, 0, 1]);
        assert_eq!(parts(&[of("a", "1"), of("b", "1"), of("a", "2")]), [0, 1, 0]);
    }

    #[test]
    fn ranks_lie_in_the_middle_of_equal_values() {
        let sorted = [1.0, 2.0, 2.0, 5.0];
        assert_eq!([0.0, 1.0, 2.0, 9.0].map(|x| rank(x, &sorted)), [-1.0, -0.75, 0.0, 1.0]);
        assert_eq!(rank(3.0, &[]), 0.0);
    }
}
