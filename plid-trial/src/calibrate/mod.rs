//! The calibration of stated probabilities: it is fitted to the outcomes of some trials and checked on others.

mod outcomes;
mod regression;
mod separation;

use std::path::{Path, PathBuf};

pub use plid_gap::answer::schema::About;
use plid_gap::calibration::{Calibration, Learnt};
use serde::Serialize;

use crate::error::TrialError;
use crate::files;
use crate::report;
use crate::statistics::{self, Rate, calibration, error_by_chance};
use outcomes::{Answers, Outcome, outcomes};
pub use separation::{FREQUENCY, Figures, Observed, PRESENT, Separation};

/// Number of parts of the cases in cross-validation. Each is predicted by coefficients that were fitted to the others.
const PARTS: usize = 10;

/// A trial with its answers, and its sealed folder.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Opened {
    /// The folder of the cases and the answers.
    pub trial: PathBuf,
    /// The sealed folder.
    pub sealed: PathBuf,
}

/// The agreement of the probabilities of one kind of statement with the outcomes.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Agreement {
    /// The kind of statement; `None` for all kinds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub about: Option<About>,
    /// The rate at which the statements were right.
    pub right: Rate,
    /// The calibration of the uncalibrated probabilities.
    pub before: statistics::Calibration,
    /// The calibration of the calibrated probabilities.
    pub after: statistics::Calibration,
    /// The expected calibration error that chance alone would give the calibrated probabilities.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub by_chance: Option<f64>,
}

/// The result of a calibration.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Calibrated {
    /// The coefficients.
    pub calibration: Calibration,
    /// Agreement on the trials that were fitted, each part of their cases with coefficients from the other parts.
    pub crossed: Vec<Agreement>,
    /// The trials on which the coefficients were checked.
    pub checked_on: Vec<Learnt>,
    /// Agreement on these trials.
    pub checked: Vec<Agreement>,
    /// How well each recorded statistic separates right first effects from wrong ones in the trials that were fitted;
    /// empty if no answer records statistics.
    pub separation: Vec<Separation>,
}

/// Fits the calibration to trials, checks it on others, and writes calibration.json, agreement.json, reliability.svg
/// and separation.csv into `out`. If `only` lists kinds of statements, the others keep the coefficients that the
/// program uses.
///
/// # Errors
/// Returns the errors of [`crate::score()`].
pub fn calibrate(fitted: &[Opened], checked: &[Opened], only: &[About], out: &Path) -> Result<Calibrated, TrialError> {
    let Together { trials, outcomes: of_fitted, observed } = together(fitted)?;
    let Together { trials: checked_on, outcomes: of_checked, .. } = together(checked)?;
    let kinds = if only.is_empty() { &About::ALL } else { only };
    let coefficients = |outcomes: &[&Outcome]| {
        let mut calibration = if only.is_empty() { Calibration::default() } else { Calibration::used().clone() };
        calibration.trials.extend(trials.iter().map(|trial| Learnt { only: only.to_vec(), ..trial.clone() }));
        for &about in kinds {
            let these: Vec<&Outcome> = outcomes.iter().copied().filter(|one| one.statement.about == about).collect();
            *calibration.of_mut(about) = regression::fit(&these, basis(about));
        }
        calibration
    };
    let calibration = coefficients(&of_fitted.iter().collect::<Vec<_>>());
    let mut cases: Vec<&String> = of_fitted.iter().map(|outcome| &outcome.case).collect();
    cases.dedup();
    let part = |outcome: &Outcome| cases.iter().position(|case| **case == outcome.case).unwrap_or(0) % PARTS;
    let parts: Vec<Calibration> = (0..PARTS)
        .map(|which| coefficients(&of_fitted.iter().filter(|one| part(one) != which).collect::<Vec<_>>()))
        .collect();
    let crossed = agreements(&of_fitted, &|outcome| parts[part(outcome)].probability(&outcome.statement));
    let checked = agreements(&of_checked, &|outcome| calibration.probability(&outcome.statement));
    let separation = separation::separation(&observed);
    let calibrated = Calibrated { calibration, crossed, checked_on, checked, separation };
    files::make(out)?;
    if !calibrated.separation.is_empty() {
        files::write(&out.join("separation.csv"), separation::csv(&calibrated.separation).as_bytes())?;
    }
    files::write_json(&out.join("calibration.json"), &calibrated.calibration)?;
    files::write_json(&out.join("agreement.json"), &calibrated)?;
    let shown = if of_checked.is_empty() { &calibrated.crossed } else { &calibrated.checked };
    if let Some(shown) = shown.first() {
        files::write(&out.join("reliability.svg"), report::before_and_after(&shown.before, &shown.after).as_bytes())?;
    }
    Ok(calibrated)
}

/// Returns the quantities that count for a kind of statement, in addition to its probability before calibration. With
/// more quantities than the outcomes can determine, the coefficients would follow chance.
fn basis(about: About) -> &'static [&'static str] {
    match about {
        About::Effect | About::Explanation => &["imperfect", "faint", "at-limit"],
        About::Further | About::Nothing | About::Remainder => &["imperfect"],
        About::Unknown => &[],
    }
}

/// The answers of several trials.
#[derive(Default)]
struct Together {
    trials: Vec<Learnt>,
    outcomes: Vec<Outcome>,
    observed: Vec<Observed>,
}

/// Returns the outcomes and the statistics of several trials. The seed of its trial precedes the name of each case, so
/// that the names differ.
fn together(opened: &[Opened]) -> Result<Together, TrialError> {
    let mut all = Together::default();
    for Opened { trial, sealed } in opened {
        let Answers { learnt, outcomes, observed } = outcomes(trial, sealed)?;
        let name = |case: &str| format!("{} {case}", learnt.seed);
        all.outcomes.extend(outcomes.into_iter().map(|one| Outcome { case: name(&one.case), ..one }));
        all.observed.extend(observed.into_iter().map(|one| Observed { case: name(&one.case), ..one }));
        all.trials.push(learnt);
    }
    Ok(all)
}

/// Returns the agreement of all statements, and of those of each kind.
fn agreements(outcomes: &[Outcome], probability: &dyn Fn(&Outcome) -> f64) -> Vec<Agreement> {
    let of = |about: Option<About>| {
        let these: Vec<&Outcome> =
            outcomes.iter().filter(|one| about.is_none_or(|about| one.statement.about == about)).collect();
        let stated =
            |p: &dyn Fn(&Outcome) -> f64| calibration(&these.iter().map(|one| (p(one), one.right)).collect::<Vec<_>>());
        (!these.is_empty()).then(|| Agreement {
            about,
            right: Rate::of(these.iter().map(|one| one.right)),
            before: stated(&|one| one.statement.before.clamp(0.0, 1.0)),
            after: stated(probability),
            by_chance: error_by_chance(&these.iter().map(|one| probability(one)).collect::<Vec<_>>()),
        })
    };
    std::iter::once(None).chain(About::ALL.map(Some)).filter_map(of).collect()
}
