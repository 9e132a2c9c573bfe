//! Which conditional expectation? NEES, accuracy and free-run error of the five against each other, against exact Bayes
//! and against batch estimates, over signal-to-noise ratios and settings of Sigma.

pub mod batch;
mod cell;
mod config;
pub use plid_model::scalar_bayes as grid;
mod method;
mod plants;
mod prediction_error;
mod report;
pub mod statistics;
mod table;
mod trial;
mod verdict;

use std::path::Path;

pub use cell::{Cell, Finished, Score};
pub use config::{Config, FULL, InClass, QUICK, Scalar, Truss};

use crate::study::{Journal, Machine, Progress, StudyError, to_toml, write, write_csv, write_json};

/// A finished study.
#[derive(Clone, Debug, PartialEq)]
pub struct Study {
    /// All cells.
    pub cells: Vec<Finished>,
    /// The results in sentences.
    pub verdict: Vec<String>,
}

/// Runs the study of `config` and writes report.html, expectations.csv, expectations.json, machine.json and config.toml
/// into `directory`. With `resume`, the cells in its journal are not run again.
///
/// # Errors
/// [`StudyError`]
pub fn run(config: &Config, directory: &Path, resume: bool, progress: &dyn Progress) -> Result<Study, StudyError> {
    let text = to_toml(config);
    let machine = Machine::here();
    let mut journal = Journal::<Finished>::open(directory, "expectations", &text, resume)?;
    let cells = cell::cells(config);
    let mut finished = Vec::new();
    for (number, cell) in cells.iter().enumerate() {
        let key = cell.key();
        if journal.get(&key).is_none() {
            progress.stage(&format!("cell {} of {}", number + 1, cells.len()));
            let measured = cell.measure(config, progress).map_err(StudyError::cell(&key))?;
            let Some(measured) = measured else { return Err(journal.interrupted()) };
            journal.append(&key, measured)?;
        }
        finished.extend(journal.get(&key).cloned());
    }
    write_json(&directory.join("expectations.json"), &finished)?;
    write_csv(&directory.join("expectations.csv"), table::rows(config, &finished))?;
    write_json(&directory.join("machine.json"), &machine)?;
    write(&directory.join("config.toml"), &text)?;
    let page = report::page(config, &finished, &machine, &text);
    write(&directory.join("report.html"), page.to_html())?;
    Ok(Study { verdict: verdict::sentences(&finished), cells: finished })
}
