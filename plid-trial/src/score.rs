//! Compares answers with the truth. The answers are recorded first, then the seals are checked, and only then is
//! anything opened.

use plid_file::sha256;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use plid_data::{MissingPolicy, channels};
use plid_gap::answer::predict::Predictor;
use plid_gap::case::{Channels, columns};
use plid_gap::effects::{Library, Range, Setting};
use plid_gap::research::Plant;
use plid_model::Model;
use plid_work::Progress;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::answer::{self, Answered};
use crate::baselines::Baselines;
use crate::diagnose::{ANSWERS, BASELINES, LEFT_OUT, Names, WHOLE};
use crate::error::TrialError;
use crate::files;
use crate::judge::{Asked, Claim, Judged, Named, asked, judge, wanted};
use crate::manifest::{DrawnCase, MANIFEST, Manifest, OpenCase, Seal};
use crate::plan::Arm;
use crate::report;
use crate::scores::{Given, Line, Scores};
use crate::seal::salted;
use crate::truth::{TrueEffect, Truth};

/// The content of S/answers.json: the answers as they were before anything was opened.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Fixed {
    /// SHA-256 of the list.
    pub(crate) sha256: String,
    /// SHA-256 of each case's answer.json, which contains the hashes of its files.
    cases: BTreeMap<String, String>,
}

pub(crate) const FIXED: &str = "answers.json";

/// The cases that are scored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Extent {
    /// All cases that were drawn.
    Whole,
    /// Only the cases that have an answer. The order of the cases is random, so these are a random sample. They are
    /// fixed as the whole would be: later answers are refused.
    Answered,
}

/// Scores a trial, and writes scores.json, report.html and its pictures power.svg and reliability.svg into `out`.
///
/// # Errors
/// Returns [`TrialError::Unanswered`] if cases have no answer, [`TrialError::Changed`] with the case whose answer has
/// changed since it was given or since it was first scored, and [`TrialError::Broken`] with a sealed file that is not
/// the one to which the trial committed.
pub fn score(
    trial: &Path,
    sealed: &Path,
    extent: Extent,
    library: &Library,
    out: &Path,
    progress: &dyn Progress,
) -> Result<Scores, TrialError> {
    let whole = Manifest::read(trial)?;
    let answers = trial.join(ANSWERS);
    let given = given(&whole, extent, &answers)?;
    let program = answer::one_program(given.iter().map(|(answered, _)| answered))?;
    let fixed = fix(&given, &sealed.join(FIXED))?;
    let seal = unseal(&whole, trial, sealed)?;
    let mut manifest = whole.clone();
    manifest.cases.retain(|case| fixed.cases.contains_key(&case.case));
    progress.stage("scoring");
    let lines = lines(trial, sealed, &manifest, &answers, &given, library, progress)?;
    let seconds = seconds(&manifest, &answers)?;
    let given = Given {
        name: seal.config.name.clone(),
        seed: seal.seed,
        answers_sha256: fixed.sha256,
        repeated_draws: seal.repeated,
        of: whole.cases.len(),
        program,
        drawn_by: seal.program.clone(),
        seconds,
    };
    let scores = Scores::new(given, lines);
    files::make(out)?;
    files::write_json(&out.join("scores.json"), &scores)?;
    if let Some(svg) = report::power(&scores) {
        files::write(&out.join("power.svg"), svg.as_bytes())?;
    }
    if let Some(svg) = report::reliability(&scores) {
        files::write(&out.join("reliability.svg"), svg.as_bytes())?;
    }
    let page = out.join("report.html");
    report::page(&scores, &seal.config).write(&page).map_err(TrialError::file(page))?;
    Ok(scores)
}

/// Compares every answer with the truth.
pub(crate) fn lines(
    trial: &Path,
    sealed: &Path,
    manifest: &Manifest,
    answers: &Path,
    given: &[(Answered, String)],
    library: &Library,
    progress: &dyn Progress,
) -> Result<Vec<Line>, TrialError> {
    progress.advance(0, manifest.cases.len());
    let done = std::sync::atomic::AtomicUsize::new(0);
    manifest
        .cases
        .par_iter()
        .zip(given)
        .map(|(case, (answered, _))| {
            let place = Place {
                trial,
                sealed: &sealed.join("cases").join(&case.case),
                answer: &answers.join(&case.case),
                case,
                library,
            };
            let lines = lines_of(&place, answered)?;
            let done = done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1;
            progress.advance(done, manifest.cases.len());
            Ok(lines)
        })
        .collect::<Result<Vec<Vec<Line>>, TrialError>>()
        .map(|lines| lines.into_iter().flatten().collect())
}

/// Returns the duration of each case.
pub(crate) fn seconds(manifest: &Manifest, answers: &Path) -> Result<Vec<f64>, TrialError> {
    manifest.cases.iter().map(|case| answer::seconds(answers, &case.case)).collect()
}

/// Returns the answers in order, each with its hash. There must be at least one, and one for every case if all are to
/// be scored.
pub(crate) fn given(
    manifest: &Manifest,
    extent: Extent,
    answers: &Path,
) -> Result<Vec<(Answered, String)>, TrialError> {
    let mut given = Vec::new();
    let mut missing = Vec::new();
    for case in &manifest.cases {
        match answer::read(answers, &case.case)? {
            Some(answer) => given.push(answer),
            None => missing.push(case.case.clone()),
        }
    }
    match missing.first() {
        Some(first) if extent == Extent::Whole || given.is_empty() => {
            let all = manifest.cases.len();
            Err(TrialError::Unanswered { missing: missing.len(), all, first: first.clone() })
        }
        _ => Ok(given),
    }
}

/// Writes the hashes of the answers into the sealed directory. If hashes already exist there, they must be the same.
pub(crate) fn fix(given: &[(Answered, String)], path: &Path) -> Result<Fixed, TrialError> {
    let cases: BTreeMap<String, String> =
        given.iter().map(|(answered, hash)| (answered.case.clone(), hash.clone())).collect();
    let fixed = Fixed { sha256: sha256(&files::json(path, &cases)?), cases };
    match fs::read(path) {
        Ok(bytes) => {
            let before: Fixed = files::parse(path, &bytes)?;
            let all = fixed.cases.keys().chain(before.cases.keys());
            if let Some(case) = all.into_iter().find(|case| before.cases.get(*case) != fixed.cases.get(*case)) {
                return Err(TrialError::Changed { case: case.clone(), since: "the answers were fixed for scoring" });
            }
        }
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => files::write_json(path, &fixed)?,
        Err(source) => return Err(TrialError::File { path: path.into(), source }),
    }
    Ok(fixed)
}

/// Reads the sealed truth after checking it against the committed hash.
pub(crate) fn unseal(manifest: &Manifest, trial: &Path, sealed: &Path) -> Result<Seal, TrialError> {
    let seal = Seal::read(sealed)?;
    if sha256(&files::read(&trial.join(MANIFEST))?) != seal.trial_sha256 {
        let reason = format!("it is not the one that {} was drawn with", sealed.display());
        return Err(TrialError::Malformed { path: trial.join(MANIFEST), reason });
    }
    check(manifest, &seal, trial, sealed)?;
    Ok(seal)
}

/// Checks that the cases and the sealed files agree with the trial's commitments.
fn check(manifest: &Manifest, seal: &Seal, trial: &Path, sealed: &Path) -> Result<(), TrialError> {
    for case in &manifest.cases {
        case.check(trial)?;
        for (file, hash) in &case.sealed {
            let path = sealed.join("cases").join(&case.case).join(file);
            if salted(&seal.salt, &case.case, file, &files::read(&path)?) != *hash {
                return Err(TrialError::Broken { case: case.case.clone(), path });
            }
        }
    }
    Ok(())
}

/// A held-out record.
struct HeldOut {
    u: Channels,
    y: Channels,
}

impl HeldOut {
    fn read(folder: &Path, model: &Model) -> Result<Self, TrialError> {
        let table = plid_data::read(&folder.join("test_uy.csv"), None)?;
        let pick = |names: &[String]| Ok::<_, TrialError>(columns(&channels(&table, names, MissingPolicy::Error)?));
        Ok(Self { u: pick(&model.inputs)?, y: pick(&model.outputs)? })
    }

    /// Returns RMS(y - simulated) / RMS(y) with each output scaled to unit RMS; `None` if it is not finite.
    fn gap(&self, simulated: &Channels) -> Option<f64> {
        let fits = |(y, s): (&Vec<f64>, &Vec<f64>)| y.len() == s.len();
        if simulated.len() != self.y.len() || !self.y.iter().zip(simulated).all(fits) {
            return None;
        }
        let share = |(y, s): (&Vec<f64>, &Vec<f64>)| {
            let error: f64 = y.iter().zip(s).map(|(y, s)| (y - s) * (y - s)).sum();
            error / y.iter().map(|y| y * y).sum::<f64>()
        };
        let squares: f64 = self.y.iter().zip(simulated).map(share).sum();
        let gap = (squares / self.y.len() as f64).sqrt();
        gap.is_finite().then_some(gap)
    }
}

/// Returns the scores of a case with the whole vocabulary and, if the effect that acts is left out for a second
/// answer, without that effect.
fn lines_of(place: &Place, answered: &Answered) -> Result<Vec<Line>, TrialError> {
    let Place { sealed: folder, case, .. } = *place;
    let path = folder.join("label.json");
    let truth: Truth = files::parse(&path, &files::read(&path)?)?;
    let path = folder.join("drawn.json");
    let drawn: DrawnCase = files::parse(&path, &files::read(&path)?)?;
    let line = |arm: Arm, without: &[String], names: Names| {
        let Verdicts { judged, covered, gap_black_box } = match answered.failed {
            Some(_) => {
                let missing = || judge(&truth, without, &Claim::missing(), None);
                let judged = [missing(), missing(), missing(), missing()];
                Verdicts { judged, covered: BTreeMap::new(), gap_black_box: None }
            }
            None => judged(place, answered, &truth, without, names)?,
        };
        let told = if without.is_empty() { String::new() } else { format!(" without {}", without.join(", ")) };
        Ok::<_, TrialError>(Line {
            case: format!("{}{told}", case.case),
            arm,
            asked: asked(&truth, without),
            truth: wanted(&truth),
            gap: truth.at_work().map(|e| e.gap).reduce(f64::min).unwrap_or(0.0),
            own_equation: truth.effects.iter().all(|e| e.own_equation),
            without: without.to_vec(),
            gap_as_given: truth.gap_sim,
            gap_floor: truth.gap_floor,
            gap_background: truth.gap_background,
            gap_black_box,
            nuisances: truth.nuisances(),
            failed: answered.failed.clone(),
            covered,
            judged,
        })
    };
    if drawn.arm != Arm::LeaveOneOut {
        return Ok(vec![line(drawn.arm, &[], WHOLE)?]);
    }
    Ok(vec![line(Arm::Single, &[], WHOLE)?, line(Arm::LeaveOneOut, &case.without, LEFT_OUT)?])
}

/// The folders of a case and of its answer, and the vocabulary of the diagnosis.
struct Place<'p> {
    trial: &'p Path,
    sealed: &'p Path,
    answer: &'p Path,
    case: &'p OpenCase,
    library: &'p Library,
}

/// The judgements of the answers to a case.
struct Verdicts {
    judged: [Judged; 4],
    /// The parameters that plid's intervals cover.
    covered: BTreeMap<String, bool>,
    /// The gap that the black box leaves.
    gap_black_box: Option<f64>,
}

/// Judges the answers of plid and of the baselines.
fn judged(
    place: &Place,
    answered: &Answered,
    truth: &Truth,
    without: &[String],
    names: Names,
) -> Result<Verdicts, TrialError> {
    let path = place.answer.join(names.diagnosis);
    let claim: Claim = files::parse(&path, &files::read(&path)?)?;
    let path = place.answer.join(BASELINES);
    let missing = Claim::missing();
    let none = || Baselines { ranking: missing.clone(), ranking_left_out: None, fitted: None };
    let baselines: Baselines =
        if answered.files.contains_key(BASELINES) { files::parse(&path, &files::read(&path)?)? } else { none() };
    let ranking =
        if without.is_empty() { &baselines.ranking } else { baselines.ranking_left_out.as_ref().unwrap_or(&missing) };
    // An answer that cannot be read back predicts nothing.
    let predictor = Predictor::read(&place.answer.join(names.simulation), place.library).ok();
    let mut gaps = [None; 4];
    let mut gap_black_box = None;
    let mut covered = BTreeMap::new();
    if let Some(predictor) = predictor {
        let held_out = HeldOut::read(place.sealed, &predictor.model)?;
        gaps[0] = held_out.gap(&predictor.run(&held_out.u, predictor.t0));
        // BIC alone has no separate fit.
        gaps[1] = gaps[0];
        if let Some(fitted) = &baselines.fitted {
            let model = Model::read(&place.trial.join("cases").join(&place.case.case).join("sim.json"))?;
            if let Ok(predicted) = fitted.predict(&model, &held_out.u, predictor.t0) {
                (gaps[2], gaps[3]) = (held_out.gap(&predicted.sparse), held_out.gap(&predicted.linear));
                gap_black_box = predicted.black_box.and_then(|y| held_out.gap(&y));
            }
        }
        if let Ok(plant) = Plant::new(&predictor.model) {
            let setting = Setting::bare(&plant, &predictor.model);
            covered = coverage(truth, without, &claim, place.library, &setting);
        }
    }
    let judged = |claim: &Claim, gap: Option<f64>| judge(truth, without, claim, gap);
    let (sparse, linear) = match &baselines.fitted {
        Some(fitted) => (&fitted.sparse.claim, &fitted.linear.claim),
        None => (&missing, &missing),
    };
    let judged = [judged(&claim, gaps[0]), judged(ranking, gaps[1]), judged(sparse, gaps[2]), judged(linear, gaps[3])];
    Ok(Verdicts { judged, covered, gap_black_box })
}

/// Returns whether the stated intervals cover the parameters of a single effect with the vocabulary's own equation.
/// Empty unless the effect is named correctly at its place and has the units of the label.
fn coverage(
    truth: &Truth,
    without: &[String],
    claim: &Claim,
    library: &Library,
    setting: &Setting,
) -> BTreeMap<String, bool> {
    let (Asked::Single, Some(effect), [said]) = (asked(truth, without), truth.at_work().next(), claim.said()) else {
        return BTreeMap::new();
    };
    let Some(known) = library.get(&effect.effect) else { return BTreeMap::new() };
    // Without declared ports, forces and motions have units that the diagnosis chooses.
    let is_force = effect.effect != "missing-mode"
        && matches!(known.side(), plid_gap::effects::Side::Structure | plid_gap::effects::Side::Disturbance)
        && !effect.effect.starts_with("modal");
    let declared = truth.nuisances().get("ports").is_some_and(|ports| ports == "yes");
    if said.effect != effect.effect || !effect.is_at(&said.location) || !effect.own_equation || (is_force && !declared)
    {
        return BTreeMap::new();
    }
    covers(effect, said, &known.parameters(setting))
}

fn covers(effect: &TrueEffect, said: &Named, parameters: &[plid_gap::effects::Parameter]) -> BTreeMap<String, bool> {
    let turns = parameters.iter().any(|p| p.range == Range::Angle);
    let mut covered = BTreeMap::new();
    for (parameter, value) in parameters.iter().zip(&effect.par) {
        let ends = said.parameters.get(&parameter.name).and_then(|stated| stated.ci95);
        // A parameter without an interval is not covered.
        let inside = |value: f64| matches!(ends, Some([Some(low), Some(high)]) if (low..=high).contains(&value));
        let hit = match parameter.range {
            // An amplitude with the opposite sign and a phase larger by half a turn give the same signal.
            Range::Angle => continue,
            Range::Signed if turns => inside(*value) || inside(-*value),
            _ => inside(*value),
        };
        covered.insert(parameter.name.clone(), hit);
    }
    covered
}

#[cfg(test)]
mod tests {
    use plid_gap::effects::Parameter;

    use super::*;
    use crate::judge::Stretch;

    #[test]
    fn the_gap_scales_each_output_to_unit_rms() {
        let held_out = HeldOut { u: vec![], y: vec![vec![3.0, -3.0], vec![100.0, 100.0]] };
        // The error is a tenth of the one output and two tenths of the other: sqrt((0.01 + 0.04) / 2).
        let gap = held_out.gap(&vec![vec![3.3, -2.7], vec![80.0, 120.0]]).unwrap();
        assert!((gap - 0.025f64.sqrt()).abs() < 1e-12);
        assert_eq!(held_out.gap(&held_out.y.clone()), Some(0.0));
        // Too few samples, too few outputs, not a number.
        assert_eq!(held_out.gap(&vec![vec![3.0], vec![1.0]]), None);
        assert_eq!(held_out.gap(&vec![vec![3.0, 3.0]]), None);
        assert_eq!(held_out.gap(&vec![vec![f64::NAN, 3.0], vec![1.0, 1.0]]), None);
    }

    #[test]
    fn a_parameter_is_covered_by_its_own_interval() {
        let effect = |par: &[f64]| TrueEffect {
            effect: "mains-hum".to_owned(),
            loc: 0,
            par: par.to_vec(),
            gap: 0.1,
            hz: 0.0,
            own_equation: true,
        };
        let stretch = |low: f64, high: f64| Stretch { ci95: Some([Some(low), Some(high)]) };
        let said = Named {
            parameters: BTreeMap::from([
                ("a".to_owned(), stretch(-0.04, -0.02)),
                ("f".to_owned(), stretch(49.9, 49.95)),
                ("phi".to_owned(), stretch(0.0, 7.0)),
                ("a3".to_owned(), stretch(0.0, 1.0)),
            ]),
            ..Named::default()
        };
        let with = |turns: bool| {
            let parameter = |name: &str, range: Range| Parameter::new(name, "", range);
            let last = parameter("phi", if turns { Range::Angle } else { Range::Positive });
            vec![parameter("a", Range::Signed), parameter("f", Range::Hz), last, parameter("a3", Range::Signed)]
        };
        let truth = effect(&[0.03, 50.0, 1.0]);
        // The opposite sign is the same signal half a turn later. An angle has no interval on a line. The label has
        // no third harmonic.
        let found = covers(&truth, &said, &with(true));
        assert_eq!(found, BTreeMap::from([("a".to_owned(), true), ("f".to_owned(), false)]));
        let found = covers(&truth, &said, &with(false));
        assert_eq!((found["a"], found["phi"]), (false, true));
        // Without an interval nothing is covered.
        let bare = Named { parameters: BTreeMap::from([("f".to_owned(), Stretch { ci95: None })]), ..Named::default() };
        assert_eq!(
            covers(&truth, &bare, &with(true)),
            BTreeMap::from([("a".to_owned(), false), ("f".to_owned(), false)])
        );
    }
}
