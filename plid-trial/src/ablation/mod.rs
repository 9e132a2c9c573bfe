//! The contribution of each step of the diagnosis: the same cases are diagnosed again with one step off at a time,
//! blind as before, and scored by the same judge.

mod report;

use std::path::{Path, PathBuf};

use plid_gap::Step;
use plid_gap::effects::Library;
use plid_work::Progress;
use serde::Serialize;

use crate::answer::{Answer, Answered};
use crate::diagnose::{ANSWERS, BASELINES, Done, answer_all, plid_without};
use crate::error::TrialError;
use crate::files;
use crate::judge::Asked;
use crate::manifest::Manifest;
use crate::score::{Extent, FIXED, fix, given, lines, seconds, unseal};
use crate::scores::{Line, Totals};
use crate::statistics::{median, paired, sign_test};

/// Answers one case, given its folder, the effects to leave out for a second answer, and the step that is off.
pub type AblatedAnswerer<'a> = dyn Fn(&Path, &[String], Option<Step>) -> Result<Answer, String> + Sync + 'a;

/// Returns the folder of the answers with a step off, or with nothing off.
fn answers(trial: &Path, off: Option<Step>) -> PathBuf {
    trial.join("ablation").join(off.map_or("nothing", Step::name))
}

/// Diagnoses the cases of a trial again: with nothing off, and with each of `steps` off. Existing answers are kept.
///
/// # Errors
/// Returns the errors of [`crate::diagnose()`].
pub fn diagnose_without(
    trial: &Path,
    steps: &[Step],
    jobs: usize,
    library: &Library,
    progress: &dyn Progress,
) -> Result<Vec<Done>, TrialError> {
    let answerer =
        |folder: &Path, without: &[String], off: Option<Step>| plid_without(folder, without, library, off.as_slice());
    diagnose_without_with(trial, steps, jobs, &answerer, progress)
}

/// Answers the cases with any diagnosis.
///
/// # Errors
/// Returns the errors of [`crate::diagnose()`].
pub fn diagnose_without_with(
    trial: &Path,
    steps: &[Step],
    jobs: usize,
    answerer: &AblatedAnswerer<'_>,
    progress: &dyn Progress,
) -> Result<Vec<Done>, TrialError> {
    let manifest = Manifest::read(trial)?;
    let cases: Vec<_> = manifest.cases.iter().collect();
    let runs = std::iter::once(None).chain(steps.iter().copied().map(Some));
    runs.map(|off| {
        progress.stage(&off.map_or("nothing off".to_owned(), |step| format!("without {step}")));
        let one = |folder: &Path, without: &[String]| answerer(folder, without, off);
        answer_all(trial, answers(trial, off), &cases, jobs, &one, progress)
    })
    .collect()
}

/// A question about a case, and whether "yes" is the good answer.
struct Reading {
    name: &'static str,
    good: bool,
    read: fn(&Line) -> Option<bool>,
}

const RIGHT: &str = "rightly answered";
const EXACT: &str = "exact";
const IN_SET: &str = "in the 95 % set";
const FALSE_ALARM: &str = "false alarm";
const WRONG: &str = "confident and wrong";

const READINGS: [Reading; 9] = [
    Reading { name: RIGHT, good: true, read: |line| Some(right(line)) },
    Reading { name: EXACT, good: true, read: |line| single(line).then(|| line.judged[0].exact) },
    Reading { name: "family", good: true, read: |line| single(line).then(|| line.judged[0].family) },
    Reading { name: "place", good: true, read: |line| single(line).then(|| line.judged[0].located) },
    Reading { name: IN_SET, good: true, read: |line| single(line).then(|| line.judged[0].in_set) },
    Reading {
        name: "all named",
        good: true,
        read: |line| (line.asked == Asked::Several).then(|| line.judged[0].all_named),
    },
    Reading {
        name: FALSE_ALARM,
        good: false,
        read: |line| (line.asked == Asked::None).then(|| line.judged[0].spurious),
    },
    Reading { name: WRONG, good: false, read: |line| Some(line.judged[0].wrong) },
    Reading { name: "kept open", good: true, read: |line| (line.asked == Asked::Outside).then(|| line.judged[0].open) },
];

fn single(line: &Line) -> bool {
    line.asked == Asked::Single
}

/// Returns whether the answer is right. One effect: it alone is named, at its place. Several: all are named and no
/// other. None: no effect is named that does not act. Outside: the answer keeps a cause outside the vocabulary open.
fn right(line: &Line) -> bool {
    let judged = &line.judged[0];
    match line.asked {
        Asked::None => !judged.spurious,
        Asked::Single => judged.exact && judged.located,
        Asked::Several => judged.all_named,
        Asked::Outside => judged.open,
    }
}

/// The comparison of one figure over the same cases with a step off and on.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Change {
    /// The name of the figure.
    pub figure: &'static str,
    /// Number of cases.
    pub of: usize,
    /// Cases that are better answered without the step.
    pub better: Vec<String>,
    /// Cases that are worse answered without it.
    pub worse: Vec<String>,
    /// The share of the cases without the step minus that with it; `None` if no case has the figure.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub difference: Option<f64>,
    /// Its 95 % interval.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ci95: Option<[f64; 2]>,
    /// The p-value of the two-sided sign test: the probability that chance alone divides better and worse at least as
    /// unevenly.
    pub p: f64,
}

/// The figures over all cases.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Figures {
    /// The figures of a trial.
    pub totals: Totals,
    /// The median duration of a case in seconds, without the baselines.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub median_s: Option<f64>,
}

/// The trial without a step.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Without {
    /// The step.
    pub step: Step,
    /// What a diagnosis does if the step is off.
    pub when_off: &'static str,
    /// SHA-256 of all answers, recorded before any sealed file was opened.
    pub answers_sha256: String,
    /// Cases whose answer differs in any byte.
    pub changed: Vec<String>,
    /// The figures over all cases.
    pub figures: Figures,
    /// The comparison with the trial's own answers, figure by figure.
    pub changes: Vec<Change>,
}

/// The content of ablation.json.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Ablation {
    /// The name of the trial.
    pub name: String,
    /// The seed from which it was drawn.
    pub seed: u64,
    /// SHA-256 of the trial's own answers.
    pub answers_sha256: String,
    /// Number of cases.
    pub cases: usize,
    /// The figures with nothing off.
    pub full: Figures,
    /// The results with each step off.
    pub steps: Vec<Without>,
}

impl Without {
    pub(crate) fn change(&self, figure: &str) -> Option<&Change> {
        self.changes.iter().find(|change| change.figure == figure)
    }
}

/// Scores the answers with each of `steps` off and the trial's own; writes ablation.json and report.html into `out`.
///
/// # Errors
/// Returns the errors of [`crate::score()`]; [`TrialError::Changed`] also if the trial's own answer is not the one
/// that this program gives with nothing off.
pub fn score_without(
    trial: &Path,
    sealed: &Path,
    steps: &[Step],
    library: &Library,
    out: &Path,
    progress: &dyn Progress,
) -> Result<Ablation, TrialError> {
    let manifest = Manifest::read(trial)?;
    let own = given(&manifest, Extent::Whole, &trial.join(ANSWERS))?;
    let again = given(&manifest, Extent::Whole, &answers(trial, None))?;
    if let Some(case) = differing(&own, &again).first() {
        return Err(TrialError::Changed {
            case: case.clone(),
            since: "the trial was diagnosed: this is another program",
        });
    }
    let fixed = fix(&own, &sealed.join(FIXED))?;
    let ablated = steps
        .iter()
        .map(|&step| {
            let answers = answers(trial, Some(step));
            let given = given(&manifest, Extent::Whole, &answers)?;
            let fixed = fix(&given, &sealed.join(format!("answers-without-{step}.json")))?;
            Ok((step, answers, given, fixed.sha256))
        })
        .collect::<Result<Vec<_>, TrialError>>()?;
    let seal = unseal(&manifest, trial, sealed)?;

    progress.stage("scoring");
    let full = lines(trial, sealed, &manifest, &trial.join(ANSWERS), &own, library, progress)?;
    let figures = |lines: &[Line], answers: &Path| {
        Ok::<_, TrialError>(Figures { totals: Totals::of(lines, 0), median_s: median(&seconds(&manifest, answers)?) })
    };
    let steps = ablated
        .into_iter()
        .map(|(step, answers, given, answers_sha256)| {
            progress.stage(&format!("scoring without {step}"));
            let lines = lines(trial, sealed, &manifest, &answers, &given, library, progress)?;
            Ok(Without {
                step,
                when_off: step.when_off(),
                answers_sha256,
                changed: differing(&own, &given),
                figures: figures(&lines, &answers)?,
                changes: READINGS.iter().map(|reading| change(reading, &full, &lines)).collect(),
            })
        })
        .collect::<Result<_, TrialError>>()?;
    let ablation = Ablation {
        name: seal.config.name.clone(),
        seed: seal.seed,
        answers_sha256: fixed.sha256,
        cases: manifest.cases.len(),
        full: figures(&full, &answers(trial, None))?,
        steps,
    };
    files::make(out)?;
    files::write_json(&out.join("ablation.json"), &ablation)?;
    let page = out.join("report.html");
    report::page(&ablation, &seal.config).write(&page).map_err(TrialError::file(page))?;
    Ok(ablation)
}

/// Returns the cases whose answers differ, or whose reasons for a missing answer differ.
fn differing(one: &[(Answered, String)], other: &[(Answered, String)]) -> Vec<String> {
    let own = |answered: &Answered| {
        let mut files = answered.files.clone();
        files.remove(BASELINES);
        files
    };
    let same = |a: &Answered, b: &Answered| a.failed == b.failed && own(a) == own(b);
    let pairs = one.iter().zip(other).filter(|((a, _), (b, _))| !same(a, b));
    pairs.map(|((a, _), _)| a.case.clone()).collect()
}

fn change(reading: &Reading, full: &[Line], without: &[Line]) -> Change {
    let pairs = full.iter().zip(without).filter_map(|(a, b)| Some((&a.case, (reading.read)(a)?, (reading.read)(b)?)));
    let pairs: Vec<(&String, bool, bool)> = pairs.collect();
    let of = pairs.len();
    let moved = |to: bool| -> Vec<String> {
        pairs.iter().filter(|(_, a, b)| a != b && *b == to).map(|(case, ..)| (*case).clone()).collect()
    };
    let (up, down) = (moved(true), moved(false));
    let p = sign_test(up.len(), down.len());
    let difference = (of > 0).then(|| (up.len() as f64 - down.len() as f64) / of as f64);
    let ci95 = (of > 0).then(|| paired(up.len(), down.len(), of));
    let (better, worse) = if reading.good { (up, down) } else { (down, up) };
    Change { figure: reading.name, of, better, worse, difference, ci95, p }
}
