//! How long a step takes, beside what the machine can do at best.
//!
//! [`carry_out`] measures, [`Outcome`] is what came of it, [`report::page`] shows it, [`compare`] holds it to a former one.

mod cell;
pub mod compare;
mod config;
mod cores;
mod count;
mod histogram;
mod limits;
mod outcome;
mod report;
mod visit;

use std::path::Path;

use serde::{Deserialize, Serialize};

pub use cell::{Cell, FORMS, OUTPUTS, word};
pub use config::{Config, Cross, FULL, QUICK};
pub use cores::Cores;
pub use histogram::Histogram;
pub use limits::Pass;
pub use outcome::{Limits, Outcome, Slope, Timing};
pub use visit::{Limit, Visit};

use crate::study::{Journal, Machine, Progress, StudyError, to_toml, write, write_csv, write_json};
use crate::{Record, Workload};
use plid_lab::variant::ScalarName;

/// One line of the journal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Entry {
    Visit(Visit),
    Limit(Limit),
    PeakGflops(f64),
}

/// Seconds of the truss that a recursion goes over.
const RECORD_S: f64 = 1.0;

/// Measures all cells of `config`, in rounds, with a journal in `directory`.
///
/// # Errors
/// A cell that cannot be measured, a journal that does not fit, or a wish for an end.
pub fn carry_out(
    config: &Config,
    directory: &Path,
    resume: bool,
    progress: &dyn Progress,
) -> Result<Outcome, StudyError> {
    let machine = Machine::here();
    let cores = Cores::choose(config.cores.as_deref(), config.threads());
    let (cells, skipped): (Vec<Cell>, Vec<Cell>) =
        config.cells().into_iter().partition(|cell| cores.suffice(cell.threads));
    let identity = format!("{}\n{}\n{cores:?}", to_toml(config), machine.identity());
    let mut journal = Journal::open(directory, "speed", &identity, resume)?;
    let records: Vec<Record> = (1..=plid_testbed::INPUTS)
        .map(|inputs| Record::truss(inputs, RECORD_S).map_err(StudyError::cell("the truss")))
        .collect::<Result<_, _>>()?;
    let (sizes, scalars) = limits(&cells);

    let total = config.rounds * (cells.len() + sizes.len() + scalars.len());
    let mut done = 0;
    for round in 0..config.rounds {
        progress.stage(&format!("round {} of {}", round + 1, config.rounds));
        let mut entry = |key: String, measure: &mut dyn FnMut() -> Result<Entry, StudyError>| {
            if progress.interrupted() {
                return Err(journal.interrupted());
            }
            let key = format!("{key} #{round}");
            if journal.get(&key).is_none() {
                journal.append(&key, measure()?)?;
            }
            done += 1;
            progress.advance(done, total);
            Ok(())
        };
        for &scalar in &scalars {
            entry(peak_key(scalar), &mut || Ok(Entry::PeakGflops(visit::peak_gflops(scalar, &cores))))?;
        }
        for &(size, scalar) in &sizes {
            entry(limit_key(size, scalar), &mut || Ok(Entry::Limit(visit::limit(scalar, size, &cores))))?;
        }
        for cell in &cells {
            entry(cell.key(), &mut || {
                let workload = Workload::new(&records[cell.inputs - 1], cell.states, cell.noise)
                    .map_err(StudyError::cell(cell.key()))?;
                let visit = visit::visit(cell, &workload, &cores, config).map_err(StudyError::cell(cell.key()))?;
                Ok(Entry::Visit(visit))
            })?;
        }
    }
    Outcome::of(config, machine, &cores, &cells, skipped, &|key, round| journal.get(&format!("{key} #{round}")), progress)
        .map_err(|interrupted| interrupted.unwrap_or_else(|| journal.interrupted()))
}
