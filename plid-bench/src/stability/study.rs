//! Runs the study: groups in parallel, the cells of a group in sequence, each recorded in the journal.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use plid_catalogue::CovarianceName;
use rayon::iter::{ParallelBridge, ParallelIterator};
use serde::{Deserialize, Serialize};

use super::cell::{self, Cell};
use super::config::Config;
use super::group::Group;
use super::problem::Problem;
use super::record::Record;
use super::reference::{Reference, ReferenceSummary, reference};
use crate::study::{Journal, Progress, Shard, StudyError, merge_shards, to_toml};

/// An entry of the journal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Entry {
    /// A cell.
    Cell(Box<Cell>),
    /// A run in double-double.
    Reference(ReferenceSummary),
}

/// All results.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// The cells, in the order of the config.
    pub cells: Vec<Cell>,
    /// The runs in double-double, in the order of the config.
    pub references: Vec<ReferenceSummary>,
}

/// Number of steps between two progress reports.
const SAY_EVERY: usize = 512;
/// Cost of a step in double-double relative to one in double precision.
const DEARER: usize = 25;

/// The study's name in its journal.
const STUDY: &str = "stability";

/// Runs the groups of cells of a shard, or all groups, unless the journal in `directory` already contains them.
///
/// # Errors
/// Returns a [`StudyError`]. Interrupted work leaves its journal.
pub fn run(
    config: &Config,
    directory: &Path,
    shard: Option<Shard>,
    resume: bool,
    progress: &dyn Progress,
) -> Result<Found, StudyError> {
    let journal = Mutex::new(Journal::open(directory, STUDY, &to_toml(config), resume)?);
    let groups = config.groups().into_iter().enumerate();
    let groups: Vec<Group> =
        groups.filter(|(index, _)| shard.is_none_or(|shard| shard.has(*index))).map(|(_, group)| group).collect();
    progress.stage("stability");
    let total: usize =
        groups.iter().map(|g| config.cells(g).iter().map(|c| work(g, g.steps_of(c.1))).sum::<usize>()).sum();
    let total = total + groups.iter().map(|g| DEARER * work(g, g.reference_steps)).sum::<usize>();
    let study = Study { config, journal, records: Mutex::default(), done: AtomicUsize::new(0), total, progress };
    groups.iter().par_bridge().try_for_each(|group| study.group(group))?;
    let journal = study.journal.into_inner().unwrap_or_else(PoisonError::into_inner);
    let mut found = Found { cells: Vec::new(), references: Vec::new() };
    for group in &groups {
        for name in group.references() {
            if let Some(Entry::Reference(reference)) = journal.get(&reference_key(group, name)) {
                found.references.push(reference.clone());
            }
        }
        for (form, scalar) in config.cells(group) {
            if let Some(Entry::Cell(cell)) = journal.get(&Cell::key(group, form, scalar)) {
                found.cells.push((**cell).clone());
            }
        }
    }
    Ok(found)
}

/// Joins the journals of all shards in `directory`.
///
/// # Errors
/// Returns a [`StudyError`].
pub fn merge(config: &Config, directory: &Path) -> Result<usize, StudyError> {
    merge_shards::<Entry>(directory, STUDY, &to_toml(config))
}

/// Returns the work of a number of steps in thousands of processed entries of P.
fn work(group: &Group, steps: usize) -> usize {
    steps * group.joint_states().pow(2) / 1000
}

fn reference_key(group: &Group, form: CovarianceName) -> String {
    format!("{}, {} double-double", group.key(), super::group::word(&form))
}

struct Study<'a> {
    config: &'a Config,
    journal: Mutex<Journal<Entry>>,
    records: Mutex<BTreeMap<String, Arc<Record>>>,
    done: AtomicUsize,
    total: usize,
    progress: &'a dyn Progress,
}

impl Study<'_> {
    fn group(&self, group: &Group) -> Result<(), StudyError> {
        let all = self.config.cells(group);
        let mut wanted: Vec<_> = {
            let journal = self.lock();
            let there = |&(form, scalar): &_| journal.get(&Cell::key(group, form, scalar)).is_some();
            all.iter().copied().filter(|cell| !there(cell)).collect()
        };
        let key = group.key();
        let problem = match wanted.is_empty() {
            true => None,
            false => {
                let record = self.record(group).map_err(StudyError::cell(&key))?;
                Some(Problem::new(group.clone(), record).map_err(StudyError::cell(&key))?)
            }
        };
        wanted.retain(|&(form, scalar)| problem.as_ref().is_some_and(|problem| problem.is_offered(form, scalar)));
        self.advance(all.iter().filter(|c| !wanted.contains(c)).map(|c| work(group, group.steps_of(c.1))).sum());
        let Some(problem) = problem.filter(|_| !wanted.is_empty()) else {
            self.advance(DEARER * work(group, group.reference_steps));
            return Ok(());
        };
        let mut known: Vec<(bool, Reference)> = Vec::new();
        for name in group.references() {
            let go = self.ticker(group, DEARER);
            let found = reference(&problem, name, &go).map_err(StudyError::cell(&key))?;
            let found = found.ok_or_else(|| self.lock().interrupted())?;
            self.lock().append(&reference_key(group, name), Entry::Reference(found.summary.clone()))?;
            known.push((name.is_factored(), found));
        }
        for (form, scalar) in wanted {
            let own =
                known.iter().rfind(|(factored, _)| !factored || form.is_factored()).map(|(_, reference)| reference);
            let cell_key = Cell::key(group, form, scalar);
            let go = self.ticker(group, 1);
            let cell = cell::run(&problem, (form, scalar), own, &go).map_err(StudyError::cell(&cell_key))?;
            let cell = cell.ok_or_else(|| self.lock().interrupted())?;
            self.advance(work(group, group.steps_of(scalar) - cell.done));
            self.lock().append(&cell_key, Entry::Cell(Box::new(cell)))?;
        }
        Ok(())
    }

    /// Returns the record of the group. That of the truss is the same for every number of states.
    fn record(&self, group: &Group) -> Result<Arc<Record>, super::scenario::RecordError> {
        let states = if group.scenario.depends_on_states() { group.states } else { 0 };
        let key = format!("{:?} {states} {}", group.scenario, group.steps);
        let mut records = self.records.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(record) = records.get(&key) {
            return Ok(record.clone());
        }
        let record = Arc::new(group.scenario.record(group.states, group.steps)?);
        records.insert(key, record.clone());
        Ok(record)
    }

    /// Counts the steps of a run, reports them at intervals, and asks whether to continue.
    fn ticker(&self, group: &Group, dearer: usize) -> impl Fn() -> bool {
        let (count, group) = (AtomicUsize::new(0), group.clone());
        move || {
            let count = 1 + count.fetch_add(1, Ordering::Relaxed);
            if count.is_multiple_of(SAY_EVERY) {
                self.advance(dearer * work(&group, SAY_EVERY));
            }
            !self.progress.interrupted()
        }
    }

    fn advance(&self, by: usize) {
        let done = by + self.done.fetch_add(by, Ordering::Relaxed);
        self.progress.advance(done.min(self.total), self.total);
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Journal<Entry>> {
        self.journal.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
