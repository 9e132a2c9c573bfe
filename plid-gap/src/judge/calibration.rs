//! The calibration of stated probabilities: the frequency with which statements like this one were right in blind
//! trials.
//!
//! Likelihoods tell how much better one explanation is than another, but not how often none of them is right. The
//! log-odds of a statement are therefore a linear function of the log-odds before calibration and of its basis
//! (logistic regression; Platt, Advances in Large Margin Classifiers, 2000, 61). `plid gap trial calibrate` fits the
//! coefficients to trials.

use std::collections::BTreeMap;
use std::sync::OnceLock;

use serde::{Deserialize, Serialize};

use crate::judge::statement::{About, Statement};

/// Largest magnitude of the log-odds, before and after calibration: no trial has enough cases to support more.
pub const MOST_LOG_ODDS: f64 = 6.0;

/// The coefficients that the program uses.
const USED: &str = include_str!("calibration.json");

/// The coefficients of the log-odds of one kind of statement.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Coefficients {
    /// The log-odds if everything else is zero.
    pub constant: f64,
    /// Factor of the log-odds before calibration.
    pub before: f64,
    /// Factors of the basis, by name. A quantity that is not listed does not count.
    pub basis: BTreeMap<String, f64>,
}

impl Default for Coefficients {
    /// Returns the coefficients that change nothing.
    fn default() -> Self {
        Self { constant: 0.0, before: 1.0, basis: BTreeMap::new() }
    }
}

impl Coefficients {
    /// Returns the calibrated probability of a statement.
    pub fn probability(&self, statement: &Statement) -> f64 {
        let basis = self.basis.iter().map(|(name, factor)| factor * statement.basis.get(name).copied().unwrap_or(0.0));
        probability(self.constant + self.before * log_odds(statement.before) + basis.sum::<f64>())
    }

    /// Returns a probability after a shift of its log-odds by the factor of one quantity of the basis.
    pub(crate) fn shifted(&self, before: f64, name: &str) -> f64 {
        probability(log_odds(before) + self.basis.get(name).copied().unwrap_or(0.0))
    }
}

/// A trial whose answers were used.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Learnt {
    /// Its name.
    pub name: String,
    /// The seed with which it was drawn.
    pub seed: u64,
    /// Number of its cases.
    pub cases: usize,
    /// The commit of the program that answered.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub commit: Option<String>,
    /// The kinds of statements whose coefficients were fitted to it; empty for all kinds.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub only: Vec<About>,
}

/// The coefficients of all kinds of statements, and the trials to which they were fitted.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// The trials.
    pub trials: Vec<Learnt>,
    /// The coefficients of the statement about the first effect.
    pub effect: Coefficients,
    /// The coefficients of the statement about the first explanation.
    pub explanation: Coefficients,
    /// The coefficients of the statements about further effects.
    pub further: Coefficients,
    /// The coefficients of "nothing is missing".
    pub nothing: Coefficients,
    /// The coefficients of "something outside the vocabulary".
    pub unknown: Coefficients,
    /// The coefficients of the statement about the remainder.
    #[serde(default)]
    pub remainder: Coefficients,
}

impl Calibration {
    /// Returns the calibration that the program uses.
    pub fn used() -> &'static Self {
        static CALIBRATION: OnceLock<Calibration> = OnceLock::new();
        CALIBRATION.get_or_init(|| serde_json::from_str(USED).unwrap_or_default())
    }

    /// Returns the coefficients for a kind of statement.
    pub fn of(&self, about: About) -> &Coefficients {
        match about {
            About::Effect => &self.effect,
            About::Explanation => &self.explanation,
            About::Further => &self.further,
            About::Nothing => &self.nothing,
            About::Unknown => &self.unknown,
            About::Remainder => &self.remainder,
        }
    }

    /// Returns a mutable reference to the coefficients for a kind of statement.
    pub fn of_mut(&mut self, about: About) -> &mut Coefficients {
        match about {
            About::Effect => &mut self.effect,
            About::Explanation => &mut self.explanation,
            About::Further => &mut self.further,
            About::Nothing => &mut self.nothing,
            About::Unknown => &mut self.unknown,
            About::Remainder => &mut self.remainder,
        }
    }

    /// Returns the calibrated probability of a statement.
    pub fn probability(&self, statement: &Statement) -> f64 {
        self.of(statement.about).probability(statement)
    }
}

/// Returns the probability with these log-odds, whose magnitude is limited to [`MOST_LOG_ODDS`].
fn probability(log_odds: f64) -> f64 {
    1.0 / (1.0 + (-log_odds.clamp(-MOST_LOG_ODDS, MOST_LOG_ODDS)).exp())
}

/// Returns the log-odds of a probability, with a magnitude of at most [`MOST_LOG_ODDS`].
pub fn log_odds(probability: f64) -> f64 {
    let odds = probability / (1.0 - probability);
    odds.max(f64::MIN_POSITIVE).ln().clamp(-MOST_LOG_ODDS, MOST_LOG_ODDS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_calibration_of_the_program_is_read() {
        let read: Calibration = serde_json::from_str(USED).unwrap();
        assert!(!read.trials.is_empty());
        assert_eq!(*Calibration::used(), read);
    }

    /// Without coefficients a statement keeps its probability, within the bound on log-odds.
    #[test]
    fn coefficients_of_nothing_change_nothing() {
        let statement = |before: f64| Statement { about: About::Effect, before, basis: BTreeMap::new() };
        for before in [0.01, 0.3, 0.98] {
            assert!((Coefficients::default().probability(&statement(before)) - before).abs() < 1e-12);
        }
        let most = 1.0 / (1.0 + (-MOST_LOG_ODDS).exp());
        assert!((Coefficients::default().probability(&statement(1.0)) - most).abs() < 1e-12);
    }

    /// A calibration without coefficients for the remainder leaves its probability as it is.
    #[test]
    fn a_calibration_may_lack_the_remainder() {
        let mut lacking = serde_json::to_value(Calibration::default()).unwrap();
        lacking.as_object_mut().unwrap().remove("remainder").unwrap();
        let read: Calibration = serde_json::from_value(lacking).unwrap();
        let statement = Statement { about: About::Remainder, before: 0.3, basis: BTreeMap::new() };
        assert!((read.probability(&statement) - 0.3).abs() < 1e-12);
    }

    /// Log-odds are added: a probability of 0.5 has log-odds of zero, and ln 3 makes the odds 3 : 1.
    #[test]
    fn a_basis_shifts_the_log_odds() {
        let basis = BTreeMap::from([("faint".to_owned(), 0.5), ("not listed".to_owned(), 9.0)]);
        let statement = Statement { about: About::Effect, before: 0.5, basis };
        let coefficients = Coefficients {
            basis: BTreeMap::from([("faint".to_owned(), 2.0 * 3.0_f64.ln())]),
            ..Coefficients::default()
        };
        assert!((coefficients.probability(&statement) - 0.75).abs() < 1e-12);
        assert!((coefficients.shifted(0.5, "faint") - 0.9).abs() < 1e-12);
    }
}
