//! The statements of a trial's answers, and whether each was right.

use std::path::Path;

use plid_gap::answer::schema::{About, Statement};
use plid_gap::calibration::Learnt;
use serde::Deserialize;

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
}

/// Returns the statements of all answers of a trial, each with its outcome. As for a score, the answers are fixed
/// before the seals are opened.
pub(crate) fn outcomes(trial: &Path, sealed: &Path) -> Result<(Learnt, Vec<Outcome>), TrialError> {
    let whole = Manifest::read(trial)?;
    let answers = trial.join(ANSWERS);
    let given = given(&whole, Extent::Answered, &answers)?;
    let program = answer::one_program(given.iter().map(|(answered, _)| answered))?;
    fix(&given, &sealed.join(FIXED))?;
    let seal = unseal(&whole, trial, sealed)?;
    let mut all = Vec::new();
    for (answered, _) in given.iter().filter(|(answered, _)| answered.failed.is_none()) {
        let Some(case) = whole.cases.iter().find(|case| case.case == answered.case) else { continue };
        let folder = sealed.join("cases").join(&case.case);
        let read = |name: &str| Ok::<_, TrialError>((folder.join(name), files::read(&folder.join(name))?));
        let (path, bytes) = read("label.json")?;
        let truth: Truth = files::parse(&path, &bytes)?;
        let (path, bytes) = read("drawn.json")?;
        let drawn: DrawnCase = files::parse(&path, &bytes)?;
        all.extend(of_answer(&answers.join(&case.case), WHOLE, &case.case, &truth, &[])?);
        if drawn.arm == Arm::LeaveOneOut {
            all.extend(of_answer(&answers.join(&case.case), LEFT_OUT, &case.case, &truth, &case.without)?);
        }
    }
    let commit = program.and_then(|program| program.commit);
    Ok((Learnt { name: seal.config.name, seed: seal.seed, cases: given.len(), commit }, all))
}

fn of_answer(
    answer: &Path,
    names: Names,
    case: &str,
    truth: &Truth,
    without: &[String],
) -> Result<Vec<Outcome>, TrialError> {
    let path = answer.join(names.diagnosis);
    let bytes = files::read(&path)?;
    let claim: Claim = files::parse(&path, &bytes)?;
    let Stated { statements } = files::parse(&path, &bytes)?;
    let judged = judge(truth, without, &claim, None);
    let acts = judged.statements;
    let what = asked(truth, without);
    let imperfections = truth.gap_background.is_some() && truth.main().is_none();
    // A delay that the audit removed is named, but it is not a statement of the search.
    let of_effects = acts.len() == statements.len();
    let right = |at: usize, about: About| match about {
        About::Effect | About::Further => of_effects.then(|| acts[at].1),
        About::Explanation => judged.top.filter(|_| of_effects).map(|(_, is_truth)| is_truth),
        About::Nothing => Some(what == Asked::None),
        About::Unknown => Some(what == Asked::Outside || imperfections),
    };
    // The first explanation has the same basis as the first effect.
    let explanation = statements.first().filter(|first| first.about == About::Effect);
    let explanation = explanation.map(|first| Statement { about: About::Explanation, ..first.clone() });
    let outcome = |(at, statement): (usize, Statement)| {
        Some(Outcome { case: case.to_owned(), right: right(at, statement.about)?, statement })
    };
    Ok(statements.into_iter().chain(explanation).enumerate().filter_map(outcome).collect())
}
