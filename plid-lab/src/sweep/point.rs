//! One point of a sweep: its folder, its run, and its row of the table.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use plid_file::write_atomic;
use plid_work::{Inner, Progress, caught};
use serde_json::Value;

use super::grid::Sweep;
use super::table::FIGURES;
use crate::experiment::{Experiment, StructureKind};
use crate::merge;
use crate::run::{self, RESULT, RunError, file_error, identity, is_finished, require_own};

/// The folder of the points in the folder of a sweep.
pub const POINTS: &str = "points";

/// The file that holds the reason why a point has no result.
const ERROR: &str = "error.txt";

/// The row of a point in the table.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// The number of the point from 1, which is also the name of its folder.
    pub number: String,
    /// The values of the varied keys.
    pub values: Vec<String>,
    /// The figures of the run, in the order of the table; `None` for a figure that the run does not have.
    pub figures: Vec<Option<Value>>,
    /// The reason why there are no figures.
    pub error: Option<String>,
}

/// A point of a sweep.
pub(super) struct Point<'a> {
    number: String,
    values: Vec<String>,
    experiment: Experiment,
    /// The folder to which the paths in the experiment are relative.
    base: &'a Path,
    folder: PathBuf,
}

impl<'a> Point<'a> {
    /// Creates the point with this index, from 0, of a sweep in `directory`.
    pub fn new(sweep: &'a Sweep, index: usize, directory: &Path) -> Self {
        let width = sweep.points().to_string().len();
        let number = format!("{:0width$}", index + 1);
        let shown = |value: &&toml::Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
        Self {
            values: sweep.values(index).iter().map(shown).collect(),
            experiment: sweep.experiment(index),
            base: &sweep.folder,
            folder: directory.join(POINTS).join(&number),
            number,
        }
    }

    /// Runs the point, unless `resume` finds its finished run. The error of a run is not an error of the sweep. It is
    /// stored in the folder of the point, and the next command that resumes the sweep repeats the run.
    pub fn run(&self, resume: bool, progress: &dyn Progress) -> Result<(), RunError> {
        let error = self.folder.join(ERROR);
        if resume && !error.exists() {
            require_own(&self.experiment, self.base, &self.folder)?;
            if self.is_finished() {
                return Ok(());
            }
        }
        fs::create_dir_all(&self.folder).map_err(file_error(&self.folder))?;
        let mut stops = None;
        let done = caught(|| match self.carry_out(resume, &Inner(progress)) {
            Err(stop) if self.is_no_fault_of_its_own(&stop) => {
                stops = Some(stop);
                Ok(())
            }
            done => done.map_err(|error| error.to_string()),
        });
        match (stops, done) {
            (Some(stop), _) => Err(stop),
            (None, Ok(())) => match fs::remove_file(&error) {
                Err(source) if source.kind() != ErrorKind::NotFound => Err(file_error(&error)(source)),
                _ => Ok(()),
            },
            (None, Err(reason)) => write_atomic(&error, format!("{reason}\n").as_bytes()).map_err(file_error(&error)),
        }
    }

    fn carry_out(&self, resume: bool, progress: &dyn Progress) -> Result<(), RunError> {
        let Self { experiment, base, folder, .. } = self;
        if experiment.structure.kind == StructureKind::SimoMerge {
            return merge::write(&merge::carry_out(experiment, base, folder, resume, progress)?, folder);
        }
        run::write(&run::carry_out(experiment, base, Some(folder), resume, progress)?, folder)
    }

    /// Whether the sweep must stop, because the user requested it, or because the folder belongs to something else or
    /// cannot be written to.
    fn is_no_fault_of_its_own(&self, error: &RunError) -> bool {
        match error {
            RunError::Interrupted { .. } | RunError::Checkpoint { .. } => true,
            RunError::File { path, .. } => path.starts_with(&self.folder),
            _ => false,
        }
    }

    fn is_finished(&self) -> bool {
        identity(&self.experiment, self.base).is_ok_and(|identity| is_finished(&self.folder, &identity))
    }

    /// Reads the row of the point; returns `None` if its run is not finished.
    pub fn row(self) -> Result<Option<Row>, RunError> {
        let error = match fs::read_to_string(self.folder.join(ERROR)) {
            Ok(reason) => Some(reason.trim_end().to_owned()),
            Err(source) if source.kind() == ErrorKind::NotFound => None,
            Err(source) => return Err(file_error(&self.folder.join(ERROR))(source)),
        };
        let figures = match &error {
            Some(_) => vec![None; FIGURES.len()],
            None if !self.is_finished() => return Ok(None),
            None => self.figures()?,
        };
        Ok(Some(Row { number: self.number, values: self.values, figures, error }))
    }

    fn figures(&self) -> Result<Vec<Option<Value>>, RunError> {
        let path = self.folder.join(RESULT);
        let bytes = fs::read(&path).map_err(file_error(&path))?;
        let result: Value = serde_json::from_slice(&bytes)
            .map_err(|error| RunError::Sweep { path, reason: format!("not the result of a run: {error}") })?;
        Ok(FIGURES.iter().map(|figure| figure.of(&result)).collect())
    }
}
