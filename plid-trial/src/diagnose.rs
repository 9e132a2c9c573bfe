//! The diagnosis of all cases of a trial, from the trial's directory alone.

use plid_file::{Folders, sha256};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use crate::answer::{self, Answer};
use crate::error::TrialError;
use crate::manifest::{MANIFEST, Manifest, OpenCase};
use crate::program::Program;
use crate::{baselines, files};
use plid_gap::case::Case;
use plid_gap::effects::Library;
use plid_gap::{Groundwork, Outcome, Step};
use plid_model::to_json;
use plid_work::{Progress, SHARD, Shard, caught};
use serde::{Deserialize, Serialize};

/// The division of the work; the answers do not depend on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Options {
    /// The shard of cases to answer; `None` for all.
    pub shard: Option<Shard>,
    /// Number of cases answered in parallel, each on one thread.
    pub jobs: usize,
}

/// The result of diagnosing a trial.
#[derive(Debug, Clone, PartialEq)]
pub struct Done {
    /// Number of cases in this shard.
    pub cases: usize,
    /// Number of cases that already had an answer.
    pub before: usize,
    /// The cases whose diagnosis failed, each with the reason, in order.
    pub failed: Vec<(String, String)>,
    /// The folder of the answers.
    pub answers: PathBuf,
}

/// The content of T/shards/i-of-N/shard.json, which is written when the shard is complete.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ShardFile {
    pub shard: Shard,
    /// SHA-256 of T/trial.json.
    pub trial_sha256: String,
    pub program: Program,
    pub cases: Vec<String>,
}

pub(crate) const ANSWERS: &str = "answers";

/// Answers one case, given its folder and the effects to leave out of the vocabulary for a second answer, if any.
pub type Answerer<'a> = dyn Fn(&Path, &[String]) -> Result<Answer, String> + Sync + 'a;

/// Diagnoses the cases of a trial that have no answer yet with the vocabulary `library`, and runs the baselines.
///
/// # Errors
/// Returns an error if the trial cannot be read or an answer cannot be written. A case that cannot be diagnosed is not
/// an error; the failure is its answer.
pub fn diagnose(
    trial: &Path,
    options: Options,
    library: &Library,
    progress: &dyn Progress,
) -> Result<Done, TrialError> {
    diagnose_with(trial, options, &|folder, without| plid(folder, without, library), progress)
}

/// Diagnoses the cases like [`diagnose`], without the baselines.
///
/// # Errors
/// Returns the errors of [`diagnose`].
pub fn diagnose_alone(
    trial: &Path,
    options: Options,
    library: &Library,
    progress: &dyn Progress,
) -> Result<Done, TrialError> {
    diagnose_with(trial, options, &|folder, without| plid_without(folder, without, library, &[]), progress)
}

/// Answers the cases with any diagnosis.
///
/// # Errors
/// Returns the errors of [`diagnose`].
pub fn diagnose_with(
    trial: &Path,
    options: Options,
    answerer: &Answerer<'_>,
    progress: &dyn Progress,
) -> Result<Done, TrialError> {
    let manifest = Manifest::read(trial)?;
    let answers = match options.shard {
        None => trial.join(ANSWERS),
        Some(shard) => shard.folder(trial),
    };
    let ours = manifest.cases.iter().enumerate().filter(|(index, _)| options.shard.is_none_or(|s| s.has(*index)));
    let ours: Vec<_> = ours.map(|(_, case)| case).collect();
    progress.stage("diagnosing");
    let done = answer_all(trial, answers, &ours, options.jobs, answerer, progress)?;
    if let Some(shard) = options.shard {
        let cases = ours.iter().map(|case| case.case.clone()).collect();
        let trial_sha256 = sha256(&files::read(&trial.join(MANIFEST))?);
        files::write_json(
            &done.answers.join(SHARD),
            &ShardFile { shard, trial_sha256, program: Program::this()?, cases },
        )?;
    }
    Ok(done)
}

/// Returns the cases that have no answer yet. Existing answers must come from this program.
fn unanswered<'a>(answers: &Path, ours: &[&'a OpenCase], program: &Program) -> Result<Vec<&'a OpenCase>, TrialError> {
    let mut open = Vec::new();
    for case in ours {
        match answer::read(answers, &case.case)? {
            None => open.push(*case),
            Some((answered, _)) if answered.program != *program => {
                return Err(TrialError::OtherProgram {
                    what: format!("the answer to {}", case.case),
                    theirs: Box::new(answered.program),
                    ours: Box::new(program.clone()),
                    running: true,
                });
            }
            Some(_) => {}
        }
    }
    Ok(open)
}

/// Answers the cases of `ours` that have no answer in `answers` yet.
pub(crate) fn answer_all(
    trial: &Path,
    answers: PathBuf,
    ours: &[&OpenCase],
    jobs: usize,
    answerer: &Answerer<'_>,
    progress: &dyn Progress,
) -> Result<Done, TrialError> {
    let written = Folders::new(&answers).map_err(TrialError::file(&answers))?;
    let open = unanswered(&answers, ours, &Program::this()?)?;
    let before = ours.len() - open.len();
    progress.advance(before, ours.len());

    let next = AtomicUsize::new(0);
    let done = AtomicUsize::new(before);
    let trouble: Mutex<Option<TrialError>> = Mutex::new(None);
    let stop = || trouble.lock().is_ok_and(|trouble| trouble.is_some()) || progress.interrupted();
    let work = || {
        let fail = |error| {
            trouble.lock().expect("nobody panics while holding it").get_or_insert(error);
        };
        // Each case uses one thread: a diagnosis that distributes its work would delay the others.
        let pool = match rayon::ThreadPoolBuilder::new().num_threads(1).build() {
            Ok(pool) => pool,
            Err(error) => {
                fail(TrialError::File { path: answers.clone(), source: std::io::Error::other(error) });
                return;
            }
        };
        while !stop() {
            let Some(case) = open.get(next.fetch_add(1, Ordering::Relaxed)) else { break };
            if let Err(error) = case.check(trial) {
                fail(error);
                break;
            }
            let clock = Instant::now();
            let folder = case.folder(trial);
            let given = caught(|| pool.install(|| answerer(&folder, &case.without)));
            if let Err(error) = answer::write(&written, &case.case, given, clock.elapsed().as_secs_f64()) {
                fail(error);
                break;
            }
            progress.advance(done.fetch_add(1, Ordering::Relaxed) + 1, ours.len());
        }
    };
    std::thread::scope(|scope| {
        (0..jobs.clamp(1, open.len().max(1))).for_each(|_| drop(scope.spawn(work)));
    });
    if let Some(error) = trouble.into_inner().expect("nobody panics while holding it") {
        return Err(error);
    }
    let mut failed = Vec::new();
    for case in ours {
        match answer::read(&answers, &case.case)? {
            Some((answered, _)) => failed.extend(answered.failed.map(|why| (case.case.clone(), why))),
            None => return Err(TrialError::Interrupted { directory: answers }),
        }
    }
    Ok(Done { cases: ours.len(), before, failed, answers })
}

/// Reads the case in a folder. Only files of the folder itself were drawn and are checked, so a case that names any
/// other file is refused.
fn case_in(folder: &Path) -> Result<Case, String> {
    let path = folder.join("case.toml");
    let case = Case::read(&path).map_err(|e| e.to_string())?;
    let inside = |name: &str| Path::new(name).file_name().is_some_and(|own| own == name);
    match case.config.files().into_iter().find(|name| !inside(name)) {
        Some(name) => Err(format!("{}: `{name}` is not a file of the case's own folder", path.display())),
        None => Ok(case),
    }
}

/// Answers a case with plid's own diagnosis and with the baselines.
fn plid(folder: &Path, without: &[String], library: &Library) -> Result<Answer, String> {
    let case = case_in(folder)?;
    let (whole, left_out) = outcomes(&case, library, without, &[])?;
    let others = baselines::answers(&case, &whole, without, library, &mut |_| {}).map_err(|e| e.to_string())?;
    let mut answer = answer_of(&whole, left_out.as_ref())?;
    answer.insert(BASELINES, files::json(Path::new(BASELINES), &others).map_err(|e| e.to_string())?);
    Ok(answer)
}

/// Answers a case with one step switched off and without baselines.
pub(crate) fn plid_without(
    folder: &Path,
    without: &[String],
    library: &Library,
    off: &[Step],
) -> Result<Answer, String> {
    let case = case_in(folder)?;
    let (whole, left_out) = outcomes(&case, library, without, off)?;
    answer_of(&whole, left_out.as_ref())
}

/// Diagnoses with the whole vocabulary and, from the same preparation, without the effects to leave out, if any.
fn outcomes(
    case: &Case,
    library: &Library,
    without: &[String],
    off: &[Step],
) -> Result<(Outcome, Option<Outcome>), String> {
    let (whole, ground) = Groundwork::whole(case, library, off, &mut |_| {}).map_err(|e| e.to_string())?;
    let left_out = (!without.is_empty()).then(|| ground.leave_out(without, &mut |_| {}));
    Ok((whole, left_out.transpose().map_err(|e| e.to_string())?))
}

fn answer_of(whole: &Outcome, left_out: Option<&Outcome>) -> Result<Answer, String> {
    let mut answer = Answer::new();
    for (names, outcome) in std::iter::once((WHOLE, whole)).chain(left_out.map(|outcome| (LEFT_OUT, outcome))) {
        let failed = |name: &'static str| move |error: plid_model::NotFinite| format!("{name}: {error}");
        answer.insert(names.diagnosis, to_json(&outcome.diagnosis).map_err(failed(names.diagnosis))?.into_bytes());
        answer.insert(names.simulation, to_json(&outcome.simulation).map_err(failed(names.simulation))?.into_bytes());
    }
    Ok(answer)
}

/// Names of the files of an answer.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Names {
    pub diagnosis: &'static str,
    pub simulation: &'static str,
}

/// The answer with the whole vocabulary.
pub(crate) const WHOLE: Names = Names { diagnosis: "diagnosis.json", simulation: "sim-with-effect.json" };
/// The answer without the effects that the case leaves out.
pub(crate) const LEFT_OUT: Names = Names { diagnosis: "left-out.json", simulation: "left-out-sim.json" };
pub(crate) const BASELINES: &str = "baselines.json";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_case_may_only_name_files_of_its_own_folder() {
        let at = tempfile::tempdir().unwrap();
        let folder = at.path().join("case-001");
        std::fs::create_dir(&folder).unwrap();
        let record = "u1,y1\n0,0\n1,0\n0,1\n1,0.5\n";
        for to in [at.path(), &folder] {
            std::fs::write(to.join("r1.csv"), record).unwrap();
        }
        let absolute = at.path().join("r1.csv").display().to_string();
        for (file, fine) in [("r1.csv", true), ("../r1.csv", false), (&absolute, false)] {
            let text = format!(
                "sample_rate_hz = 100\ninputs = [\"u1\"]\noutputs = [\"y1\"]\n\n[[record]]\nfile = \"{file}\"\n\
                excitation = \"random\"\n"
            );
            std::fs::write(folder.join("case.toml"), text).unwrap();
            let read = case_in(&folder);
            assert_eq!(read.is_ok(), fine, "{:?}", read.err());
            assert!(fine || read.unwrap_err().contains("is not a file of the case's own folder"));
        }
    }
}
