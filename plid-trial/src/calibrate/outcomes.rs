//! The statements of a trial's answers, and whether each was right.

use std::path::Path;

use plid_gap::answer::schema::{About, Statement, Statistics};
use plid_gap::calibration::{CONFIDENCE, Learnt};
use serde::Deserialize;

use super::separation::Observed;
use crate::answer;
use crate::diagnose::{ANSWERS, LEFT_OUT, Names, WHOLE};
use crate::error::TrialError;
use crate::files;
use crate::judge::{Asked, Claim, asked, judge};
use crate::manifest::{DrawnCase, Manifest};
use crate::plan::Arm;
use crate::score::{Extent, FIXED, fix, given, unseal};
use crate::truth::Truth;

/// A statement and whether it was right.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// The case. The statements of one case are not independent.
    pub case: String,
    /// The statement.
    pub statement: Statement,
    /// Whether it was right.
    pub right: bool,
}

/// The statements of diagnosis.json.
#[derive(Deserialize)]
struct Stated {
    #[serde(default)]
    statements: Vec<Statement>,
    statistics: Option<Statistics>,
}

/// The answers of a trial.
pub(crate) struct Answers {
    /// The trial.
    pub learnt: Learnt,
    /// Their statements.
    pub outcomes: Vec<Outcome>,
    /// The statistics of those that record them.
    pub observed: Vec<Observed>,
}

/// Returns the statements and the statistics of all answers of a trial, each with its outcome. As for a score, the
/// answers are fixed before the seals are opened.
pub(crate) fn outcomes(trial: &Path, sealed: &Path) -> Result<Answers, TrialError> {
    let whole = Manifest::read(trial)?;
    let answers = trial.join(ANSWERS);
    let given = given(&whole, Extent::Answered, &answers)?;
    let program = answer::one_program(given.iter().map(|(answered, _)| answered))?;
    fix(&given, &sealed.join(FIXED))?;
    let seal = unseal(&whole, trial, sealed)?;
    let (mut outcomes, mut observed) = (Vec::new(), Vec::new());
    for (answered, _) in given.iter().filter(|(answered, _)| answered.failed.is_none()) {
        let Some(case) = whole.cases.iter().find(|case| case.case == answered.case) else { continue };
        let folder = sealed.join("cases").join(&case.case);
        let read = |name: &str| Ok::<_, TrialError>((folder.join(name), files::read(&folder.join(name))?));
        let (path, bytes) = read("label.json")?;
        let truth: Truth = files::parse(&path, &bytes)?;
        let (path, bytes) = read("drawn.json")?;
        let drawn: DrawnCase = files::parse(&path, &bytes)?;
        let mut read = |names: Names, without: &[String]| -> Result<(), TrialError> {
            let path = answers.join(&case.case).join(names.diagnosis);
            let bytes = files::read(&path)?;
            let stated: Stated = files::parse(&path, &bytes)?;
            let trial = format!("{} {}", seal.config.name, seal.seed);
            observed.extend(of_statistics(&stated, trial, &case.case, &truth));
            outcomes.extend(of_answer(stated, &files::parse(&path, &bytes)?, &case.case, &truth, without));
            Ok(())
        };
        read(WHOLE, &[])?;
        if drawn.arm == Arm::LeaveOneOut {
            read(LEFT_OUT, &case.without)?;
        }
    }
    let commit = program.and_then(|program| program.commit);
    let learnt = Learnt { name: seal.config.name, seed: seal.seed, cases: given.len(), commit, only: Vec::new() };
    Ok(Answers { learnt, outcomes, observed })
}

/// Returns the statistics of an answer, if it records them.
fn of_statistics(stated: &Stated, trial: String, case: &str, truth: &Truth) -> Option<Observed> {
    let Statistics { effect, location, values } = stated.statistics.as_ref()?;
    let mut values = values.clone();
    Some(Observed {
        trial,
        case: case.to_owned(),
        before: values.remove(CONFIDENCE)?,
        basis: stated.statements.first()?.basis.clone(),
        values,
        right: truth.acts(effect, location),
    })
}

fn of_answer(stated: Stated, claim: &Claim, case: &str, truth: &Truth, without: &[String]) -> Vec<Outcome> {
    let statements = stated.statements;
    let judged = judge(truth, without, claim, None);
    let acts = judged.statements;
    let what = asked(truth, without);
    let imperfections = truth.gap_background.is_some() && truth.main().is_none();
    // A delay that the audit removed is named, but it is not a statement of the search.
    let is_of_effect = |one: &&Statement| matches!(one.about, About::Effect | About::Further);
    let of_effects = acts.len() == statements.iter().filter(is_of_effect).count();
    let right = |at: usize, about: About| match about {
        About::Effect | About::Further => of_effects.then(|| acts[at].1),
        About::Explanation => judged.explanation.filter(|_| of_effects).map(|(_, is_truth)| is_truth),
        About::Nothing => Some(what == Asked::None),
        About::Unknown => Some(what == Asked::Outside || imperfections),
        About::Remainder => judged.further_cause.map(|(_, there_is)| there_is),
    };
    // The first explanation has the same basis as the first effect.
    let explanation = statements.first().filter(|first| first.about == About::Effect);
    let explanation = explanation.map(|first| Statement { about: About::Explanation, ..first.clone() });
    let outcome = |(at, statement): (usize, Statement)| {
        Some(Outcome { case: case.to_owned(), right: right(at, statement.about)?, statement })
    };
    statements.into_iter().chain(explanation).enumerate().filter_map(outcome).collect()
}
