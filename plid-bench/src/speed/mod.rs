//! The study of speed, which compares the time of a step with the limits of the machine.
//!
//! [`carry_out`] measures, [`Outcome`] holds the results, [`write_all`] writes the files, and [`compare`] compares them
//! with those of an earlier run.

mod allocated;
mod cell;
pub mod compare;
mod config;
mod cores;
mod count;
mod histogram;
mod limits;
mod outcome;
pub mod parts;
pub mod peers;
mod pictures;
mod report;
mod targets;
mod traffic;
mod visit;

use std::path::Path;

use plid_catalogue::ScalarName;
use serde::{Deserialize, Serialize};

pub use allocated::count_allocations_by;
pub use cell::{Cell, OUTPUTS, expectations, word};
pub use config::{Config, Cross, FULL, QUICK};
pub use cores::Cores;
pub use count::Operations;
pub use histogram::Histogram;
pub use limits::{Pass, peak, time};
pub use outcome::{Limits, Outcome, Peak, Slope, Timing};
pub use targets::{Target, targets};
pub use visit::{Limit, Visit};

use crate::study::{Journal, Machine, Progress, StudyError, to_toml, write, write_csv, write_json};
use crate::{Record, Workload};

/// One line of the journal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Entry {
    /// Steps of a cell in one round.
    Visit(Visit),
    /// Passes over matrices in one round.
    Limit(Limit),
    /// The speed of one core in registers, in 10^9 multiplications and additions per second.
    PeakGflops(f64),
    /// The operations of a step.
    Operations(Operations),
}

/// Length of the record of the truss in s.
const RECORD_S: f64 = 1.0;

/// The measurements, in the order of a round.
#[derive(Clone, Debug)]
enum Item {
    Peak(ScalarName),
    Limit(usize, ScalarName),
    Cell(Cell),
}

impl Item {
    fn key(&self) -> String {
        match self {
            Self::Peak(scalar) => format!("peak {}", word(scalar)),
            Self::Limit(size, scalar) => format!("pass N={size} {}", word(scalar)),
            Self::Cell(cell) => cell.key(),
        }
    }
}

/// Returns the limits that the cells need, followed by the cells.
fn items(cells: &[Cell]) -> Vec<Item> {
    let mut items: Vec<Item> = Vec::new();
    let mut add = |item: Item| {
        if !items.iter().any(|other| other.key() == item.key()) {
            items.push(item);
        }
    };
    cells.iter().for_each(|cell| add(Item::Peak(cell.variant.scalar)));
    cells.iter().for_each(|cell| add(Item::Limit(cell.joint_states(), cell.variant.scalar)));
    cells.iter().for_each(|cell| add(Item::Cell(*cell)));
    items
}

/// Measures all cells of `config` in rounds, with a journal in `directory`.
///
/// # Errors
/// Returns an error for a cell that cannot be measured, a journal of another study, or an interruption.
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
    let mut journal: Journal<Entry> = Journal::open(directory, "speed", &identity, resume)?;
    let records: Vec<Record> = (1..=plid_testbed::INPUTS)
        .map(|inputs| Record::truss(inputs, RECORD_S).map_err(StudyError::cell("the truss")))
        .collect::<Result<_, _>>()?;
    let workload = |cell: &Cell| {
        Workload::new(&records[cell.inputs - 1], cell.states, cell.noise).map_err(StudyError::cell(cell.key()))
    };
    let items = items(&cells);

    let mut keep = |key: String, measure: &mut dyn FnMut() -> Result<Entry, StudyError>| {
        if progress.interrupted() {
            return Err(journal.interrupted());
        }
        match journal.get(&key) {
            Some(entry) => Ok(entry.clone()),
            None => {
                let entry = measure()?;
                journal.append(&key, entry.clone())?;
                Ok(entry)
            }
        }
    };
    let mut found = outcome::Found::default();
    for round in 0..config.rounds {
        progress.stage(&format!("round {} of {}", round + 1, config.rounds));
        for (done, item) in items.iter().enumerate() {
            progress.advance(done, items.len());
            let entry = keep(format!("{} #{round}", item.key()), &mut || {
                Ok(match item {
                    Item::Peak(scalar) => Entry::PeakGflops(visit::peak_gflops(*scalar, &cores)),
                    Item::Limit(size, scalar) => Entry::Limit(visit::limit(*scalar, *size, &cores)),
                    Item::Cell(cell) => Entry::Visit(
                        visit::visit(cell, &workload(cell)?, &cores, config).map_err(StudyError::cell(cell.key()))?,
                    ),
                })
            })?;
            found.take(item.key(), entry);
        }
    }
    progress.stage("counting operations");
    for (done, cell) in cells.iter().enumerate() {
        progress.advance(done, cells.len());
        let key = cell.operations_key();
        let entry = keep(key.clone(), &mut || {
            count::count(cell, &workload(cell)?).map(Entry::Operations).map_err(StudyError::cell(cell.key()))
        })?;
        found.take(key, entry);
    }
    Ok(found.outcome(config, machine, &cores, &items, &skipped))
}

/// Writes report.html, speed.json, speed.csv, machine.json and the config into `directory`.
///
/// # Errors
/// Returns an error for a file that cannot be written.
pub fn write_all(outcome: &Outcome, peers: Option<&peers::Peers>, directory: &Path) -> Result<(), StudyError> {
    write(&directory.join("config.toml"), to_toml(&outcome.config))?;
    write_json(&directory.join("machine.json"), &outcome.machine)?;
    write_csv(&directory.join("speed.csv"), outcome.rows())?;
    write(&directory.join("report.html"), report::page(outcome, peers).to_html())?;
    // This file is written last, so that its presence shows that the other files exist.
    write_json(&directory.join("speed.json"), outcome)
}
