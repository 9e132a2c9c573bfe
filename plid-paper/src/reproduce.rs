//! Runs all claims, in sequence or in parallel, and saves each as soon as it is complete.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use plid_bench::study::{Journal, Machine, Progress, Shard, StudyError, merge_shards, shard, write, write_json};
use plid_file::{executable_sha256, sha256};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::claim::{Claim, Context, Finding, Panel, Verdict};
use crate::page::{self, Line};

/// The claims to run, and how.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// The claims; empty for all.
    pub only: Vec<String>,
    /// Whether to use the quick tables of the configs.
    pub quick: bool,
    /// A directory whose configs replace the built-in ones.
    pub configs: Option<PathBuf>,
    /// Whether to discard what the output directory contains.
    pub anew: bool,
    /// The shard of the claims to run, in its own folder in the output directory; `None` for all.
    pub shard: Option<Shard>,
    /// Whether to take the findings from all shards in the output directory, and to run nothing.
    pub merge: bool,
}

/// A finished claim in the journal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Done {
    /// The result.
    pub finding: Finding,
    /// The duration in s.
    pub seconds: f64,
}

/// A claim with the configs in use.
struct Task {
    claim: Claim,
    config: String,
    vary: String,
    key: String,
}

/// The name of the study in its journal, and the config of the journal. The keys of the cells state on what they
/// depend.
const STUDY: (&str, &str) = ("paper", "claims");

/// Runs the claims and writes DIR/ID/claim.json with plots and configs for each, and DIR/claims.json and
/// DIR/report.html for all of them. A claim is not repeated if DIR already contains its result for the same configs
/// from the same build of the program.
///
/// # Errors
/// Returns [`StudyError::Cell`] for a claim that cannot be run, after the others are done, [`StudyError::Interrupted`],
/// or the error of a file.
pub fn reproduce(
    claims: &[Claim],
    options: &Options,
    directory: &Path,
    progress: &dyn Progress,
) -> Result<Vec<Line>, StudyError> {
    match options.shard {
        Some(own) => shard(directory, own, |folder| run(claims, options, folder, progress)),
        None => run(claims, options, directory, progress),
    }
}

fn run(
    claims: &[Claim],
    options: &Options,
    directory: &Path,
    progress: &dyn Progress,
) -> Result<Vec<Line>, StudyError> {
    let program = executable_sha256().map_err(StudyError::file("the program's executable"))?;
    let tasks = claims.iter().map(|claim| task(claim, options, &program)).collect::<Result<Vec<Task>, _>>()?;
    if options.merge {
        merge_shards::<Done>(directory, STUDY.0, STUDY.1)?;
    }
    let journal: Journal<Done> = Journal::open(directory, STUDY.0, STUDY.1, !options.anew || options.merge)?;
    let missing: Vec<&Task> = options.own(&tasks).filter(|task| journal.get(&task.key).is_none()).collect();
    if let (true, Some(task)) = (options.merge, missing.first()) {
        let id = task.claim.id;
        return Err(StudyError::Shards(format!(
            "{id}: no shard has run this claim with these options and configs by this build of the program"
        )));
    }
    // An earlier run in the same directory may have been quick while this one is not, so the files are rewritten from
    // the journal.
    for task in &tasks {
        if let Some(done) = journal.get(&task.key) {
            keep(task, &done.finding, &directory.join(task.claim.id))?;
        }
    }
    // The load is measured now, because at the end it would be that of this program.
    let machine = Machine::here();
    let (quick, journal) = (options.quick, Mutex::new(journal));
    let work = Work { quick, directory, progress, journal, done: AtomicUsize::new(0), total: missing.len() };
    let results = work.all(&missing);
    let journal = work.journal.into_inner().unwrap_or_else(PoisonError::into_inner);

    let lines: Vec<Line> = tasks
        .into_iter()
        .map(|task| {
            let found = journal.get(&task.key).cloned();
            let (finding, seconds) = found.map_or((None, None), |done| (Some(done.finding), Some(done.seconds)));
            Line { claim: task.claim, config: task.config, vary: task.vary, finding, seconds }
        })
        .collect();
    write_json(&directory.join("claims.json"), &lines.iter().filter_map(Line::summary).collect::<Vec<_>>())?;
    write(&directory.join("report.html"), page::page(&lines, options.quick, &machine).to_html())?;
    // An interruption takes precedence over other errors.
    let failed = results.into_iter().filter_map(Result::err);
    let first = failed.min_by_key(|error| !matches!(error, StudyError::Interrupted { .. }));
    first.map_or(Ok(lines), Err)
}

impl Options {
    /// Returns the requested tasks, which are those of `only`, and of these the ones in the shard.
    fn own<'t>(&self, tasks: &'t [Task]) -> impl Iterator<Item = &'t Task> {
        let asked = tasks.iter().filter(|task| self.only.is_empty() || self.only.iter().any(|id| id == task.claim.id));
        asked.enumerate().filter(|(index, _)| self.shard.is_none_or(|shard| shard.has(*index))).map(|(_, task)| task)
    }
}

/// The claims that are being run.
struct Work<'a> {
    quick: bool,
    directory: &'a Path,
    progress: &'a dyn Progress,
    journal: Mutex<Journal<Done>>,
    done: AtomicUsize,
    total: usize,
}

impl Work<'_> {
    fn all(&self, tasks: &[&Task]) -> Vec<Result<(), StudyError>> {
        self.progress.stage("claims");
        self.progress.advance(0, self.total);
        let (timed, plain): (Vec<&Task>, Vec<&Task>) = tasks.iter().partition(|task| task.claim.timed);
        // It would be better to start with the longest claims, but these are not known. Threads share the work within
        // a claim.
        let mut results: Vec<Result<(), StudyError>> = plain.par_iter().map(|task| self.one(task)).collect();
        // Timed claims run alone, because other work would disturb the timing.
        results.extend(timed.iter().map(|task| self.one(task)));
        results
    }

    fn one(&self, task: &Task) -> Result<(), StudyError> {
        if self.progress.interrupted() {
            return Err(self.journal().interrupted());
        }
        let at = self.directory.join(task.claim.id);
        // Claims write data files there before they are done.
        fs::create_dir_all(&at).map_err(StudyError::file(&at))?;
        let context = Context {
            id: task.claim.id,
            quick: self.quick,
            config: &task.config,
            vary: &task.vary,
            directory: &at,
            progress: self.progress,
        };
        let start = Instant::now();
        let finding = match (task.claim.run)(&context) {
            Ok(finding) => finding,
            // The user requested the interruption, whatever the error.
            Err(_) if self.progress.interrupted() => return Err(self.journal().interrupted()),
            Err(source) => return Err(StudyError::Cell { cell: task.claim.id.into(), source }),
        };
        let finished = Done { finding, seconds: start.elapsed().as_secs_f64() };
        keep(task, &finished.finding, &at)?;
        self.journal().append(&task.key, finished)?;
        self.progress.advance(self.done.fetch_add(1, Ordering::Relaxed) + 1, self.total);
        Ok(())
    }

    fn journal(&self) -> MutexGuard<'_, Journal<Done>> {
        self.journal.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn task(claim: &Claim, options: &Options, program: &str) -> Result<Task, StudyError> {
    let read = |name: String, built_in: &str| match &options.configs {
        Some(directory) if !built_in.is_empty() => {
            let path = directory.join(name);
            fs::read_to_string(&path).map_err(StudyError::file(path))
        }
        _ => Ok(built_in.to_string()),
    };
    let config = read(format!("{}.toml", claim.id), claim.config)?;
    let vary = read(format!("{}.vary.toml", claim.id), claim.vary)?;
    let hash = sha256(format!("{program}\n{}\n{config}\n{vary}", options.quick));
    Ok(Task { claim: *claim, key: format!("{} {hash}", claim.id), config, vary })
}

/// Writes the files of the claim.
fn keep(task: &Task, finding: &Finding, at: &Path) -> Result<(), StudyError> {
    let id = task.claim.id;
    fs::create_dir_all(at).map_err(StudyError::file(at))?;
    write(&at.join(format!("{id}.toml")), &task.config)?;
    if !task.vary.is_empty() {
        write(&at.join(format!("{id}.vary.toml")), &task.vary)?;
    }
    let mut panels = Vec::new();
    for (number, panel) in finding.panels.iter().enumerate() {
        panels.push(match panel {
            Panel::Picture { svg, caption } => {
                let file = format!("{id}-{}.svg", number + 1);
                write(&at.join(&file), svg)?;
                serde_json::json!({ "picture": file, "caption": caption })
            }
            table => serde_json::json!(table),
        });
    }
    let mut record = serde_json::json!(Summary::of(&task.claim, finding));
    record["panels"] = panels.into();
    // This file is written last, so that its presence shows that the others exist.
    write_json(&at.join("claim.json"), &record)
}

/// An entry of claims.json.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// The claim.
    pub id: &'static str,
    /// The statement of the paper.
    pub statement: &'static str,
    /// The verdict.
    pub verdict: Verdict,
    /// Whether figures and sentence depend on times and therefore differ from run to run.
    pub timed: bool,
    /// The result in words.
    pub sentence: String,
    /// The rules of the verdict.
    pub parts: Vec<crate::claim::Part>,
    /// The figures.
    pub figures: Vec<crate::claim::Figure>,
}

impl Summary {
    /// Creates the entry of a finding.
    pub fn of(claim: &Claim, finding: &Finding) -> Self {
        Self {
            id: claim.id,
            statement: claim.statement,
            verdict: finding.verdict(),
            timed: claim.timed,
            sentence: finding.sentence.clone(),
            parts: finding.parts.clone(),
            figures: finding.figures.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_claim_is_kept_under_its_configs_and_its_program() {
        let key = |quick: bool, program: &str| {
            let options = Options { quick, ..Options::default() };
            task(&crate::claims::CLAIMS[0], &options, program).unwrap().key
        };
        assert_eq!(key(true, "one"), key(true, "one"));
        assert_ne!(key(true, "one"), key(false, "one"));
        assert_ne!(key(true, "one"), key(true, "another"));
    }
}
