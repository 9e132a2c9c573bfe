//! The study of conditional expectations. It compares NEES, accuracy and free-run error of the five expectations with
//! each other, with exact Bayes and with batch estimates, over signal-to-noise ratios and settings of Sigma.

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

use plid_file::to_json;

use crate::study::{
    self, Journal, Machine, Progress, Shard, StudyError, merge_shards, to_toml, write, write_csv, write_json,
};

/// A finished study.
#[derive(Clone, Debug, PartialEq)]
pub struct Study {
    /// All cells.
    pub cells: Vec<Finished>,
    /// The results in sentences.
    pub verdict: Vec<String>,
}

impl Study {
    /// Returns the content of expectations.json: all cells.
    ///
    /// # Errors
    /// Returns [`StudyError::NotFinite`] with the place of a number that is not finite.
    pub fn json(&self) -> Result<String, StudyError> {
        to_json(&self.cells).map_err(StudyError::not_finite("expectations.json"))
    }
}

/// Runs the study of `config` and writes report.html, expectations.csv, expectations.json, machine.json and config.toml
/// into `directory`. With `resume`, the cells in its journal are not run again.
///
/// # Errors
/// Returns a [`StudyError`].
pub fn run(config: &Config, directory: &Path, resume: bool, progress: &dyn Progress) -> Result<Study, StudyError> {
    let text = to_toml(config);
    let machine = Machine::here();
    let finished = measure(config, directory, None, resume, progress)?;
    let study = Study { verdict: verdict::sentences(&finished), cells: finished };
    write(&directory.join("expectations.json"), study.json()?)?;
    let finished = &study.cells;
    write_csv(&directory.join("expectations.csv"), table::rows(config, finished))?;
    write_json(&directory.join("machine.json"), &machine)?;
    write(&directory.join("config.toml"), &text)?;
    let page = report::page(config, finished, &machine, &text);
    write(&directory.join("report.html"), page.to_html())?;
    Ok(study)
}

/// Runs the cells of a shard in its own folder in `directory`.
///
/// # Errors
/// Returns a [`StudyError`].
pub fn run_shard(
    config: &Config,
    directory: &Path,
    shard: Shard,
    resume: bool,
    progress: &dyn Progress,
) -> Result<(), StudyError> {
    study::shard(directory, shard, |folder| measure(config, folder, Some(shard), resume, progress).map(|_| ()))
}

/// Copies the cells of all shards to the journal in `directory`, where [`run`] resumes with nothing left to measure.
///
/// # Errors
/// Returns [`StudyError::Shards`] if a shard is missing or not complete, or the error of a file.
pub fn merge(config: &Config, directory: &Path) -> Result<usize, StudyError> {
    merge_shards::<Finished>(directory, STUDY, &to_toml(config))
}

/// The study's name in its journal.
const STUDY: &str = "expectations";

/// Measures the cells of a shard, or all cells, unless the journal in `directory` already contains them.
fn measure(
    config: &Config,
    directory: &Path,
    shard: Option<Shard>,
    resume: bool,
    progress: &dyn Progress,
) -> Result<Vec<Finished>, StudyError> {
    let mut journal = Journal::<Finished>::open(directory, STUDY, &to_toml(config), resume)?;
    let cells = cell::cells(config);
    let mut finished = Vec::new();
    let own = cells.iter().enumerate().filter(|(index, _)| shard.is_none_or(|shard| shard.has(*index)));
    for (index, cell) in own {
        let key = cell.key();
        if journal.get(&key).is_none() {
            progress.stage(&format!("cell {} of {}", index + 1, cells.len()));
            let measured = cell.measure(config, progress).map_err(StudyError::cell(&key))?;
            let Some(measured) = measured else { return Err(journal.interrupted()) };
            journal.append(&key, measured)?;
        }
        finished.extend(journal.get(&key).cloned());
    }
    Ok(finished)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_figure_that_is_not_finite_is_refused_by_its_path() {
        let cell = |sigma| Finished {
            plant: "scalar".into(),
            signal_to_noise: 10.0,
            sigma,
            runs: 1,
            reference: None,
            scores: Vec::new(),
        };
        let study = |sigma| Study { cells: vec![cell(1.0), cell(sigma)], verdict: Vec::new() };
        let read: Vec<Finished> = serde_json::from_str(&study(2.0).json().unwrap()).unwrap();
        assert_eq!(read, study(2.0).cells);
        let refused = study(f64::NAN).json().unwrap_err().to_string();
        assert!(refused.contains("expectations.json: `[1].sigma` is NaN"), "{refused}");
    }
}
