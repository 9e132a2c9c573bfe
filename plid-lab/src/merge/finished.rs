//! A finished run, read from its output directory.

use std::path::Path;

use plid_model::Model;
use serde::Deserialize;

use super::MergeError;
use super::merged::Piece;
use crate::experiment::{Experiment, from_toml};
use crate::run::{Estimate, RunError, canonical};

/// The results of a run that a merge uses.
#[derive(Clone, Debug)]
pub struct FinishedRun {
    /// The name of the directory in errors and reports.
    pub name: String,
    /// The model in canonical form with its parameter covariance, in the data's units, before an input advance is
    /// undone.
    pub model: Model,
    /// Number of samples by which its input was advanced.
    pub advanced: usize,
    /// Prior, covariance scale and channels.
    pub estimate: Estimate,
    /// Number of training samples.
    pub training_samples: usize,
    /// Relative simulation error on its own held-out data; `None` if it diverged.
    pub free_run: Option<f64>,
    /// The experiment of the run.
    pub experiment: Experiment,
}

/// The keys of result.json that a merge reads; all others are ignored.
#[derive(Deserialize)]
struct ResultFile {
    estimate: Estimate,
    input_advanced_by: usize,
    training_samples: usize,
    held_out: HeldOut,
}

#[derive(Deserialize)]
struct HeldOut {
    free_run: FreeRun,
}

#[derive(Deserialize)]
struct FreeRun {
    overall_relative: Option<f64>,
}

#[derive(Deserialize)]
struct Manifest {
    experiment_toml: String,
}

impl FinishedRun {
    /// Reads model.json, result.json and manifest.json of `directory`.
    ///
    /// # Errors
    /// Returns an error if a file or key is missing; earlier versions of plid wrote fewer keys.
    pub fn read(directory: &Path) -> Result<Self, RunError> {
        let path = |name: &str| directory.join(name);
        let result: ResultFile = read(&path("result.json"))?;
        let manifest: Manifest = read(&path("manifest.json"))?;
        let experiment = from_toml(&manifest.experiment_toml, &path("manifest.json").display().to_string())?;
        let model = Model::read(&path("model.json"))?;
        let key = |key: &str, problem: &str| MergeError::Key {
            file: path("model.json"),
            key: key.into(),
            problem: problem.into(),
        };
        if model.observability_indices.is_none() {
            return Err(key("observability_indices", "is missing: the model is not in canonical form").into());
        }
        if model.parameter_covariance.is_none() {
            return Err(key("parameter_covariance", "is missing").into());
        }
        let model = canonical(&model).map_err(|reason| key("D", &format!("cannot be undone: {reason}")))?;
        Ok(Self {
            name: directory.display().to_string(),
            model,
            advanced: result.input_advanced_by,
            estimate: result.estimate,
            training_samples: result.training_samples,
            free_run: result.held_out.free_run.overall_relative,
            experiment,
        })
    }

    pub(super) fn piece(&self) -> Piece<'_> {
        Piece { name: &self.name, model: &self.model, estimate: &self.estimate }
    }
}

fn read<T: for<'de> Deserialize<'de>>(path: &Path) -> Result<T, RunError> {
    let text = std::fs::read_to_string(path).map_err(|source| RunError::File { path: path.into(), source })?;
    serde_json::from_str(&text).map_err(|error| {
        // "missing field `estimate` at line 1 column 2" names the key; any other message is passed on unchanged.
        let message = error.to_string();
        let key = message.split('`').nth(1).unwrap_or("?").to_string();
        MergeError::Key { file: path.into(), key, problem: format!("cannot be read: {message}") }.into()
    })
}
