//! A finished run, read from its directory.

use std::path::Path;

use plid_model::Model;
use serde::Deserialize;

use super::MergeError;
use super::merged::Piece;
use crate::experiment::{Experiment, from_toml};
use crate::run::{Estimate, RunError, canonical};

/// What a merge needs of a run.
#[derive(Clone, Debug)]
pub struct FinishedRun {
    /// Its directory, as errors and reports name it.
    pub name: String,
    /// Its model in canonical form, before an advanced input was undone; in the data's units, with the parameters' covariance.
    pub model: Model,
    /// Samples by which its input was advanced.
    pub advanced: usize,
    /// Prior, scale and channels.
    pub estimate: Estimate,
    /// Samples that it learnt from.
    pub training_samples: usize,
    /// Its own free-run error on its own held-out part, relative; `None` where it diverged.
    pub free_run: Option<f64>,
    /// The experiment that it was.
    pub experiment: Experiment,
}

/// The keys of result.json that a merge reads; the others are passed over.
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
    /// A file that is missing, or lacks a key: an older plid wrote fewer.
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
        // "missing field `estimate` at line 1 column 2" names the key; anything else is said as it is.
        let message = error.to_string();
        let key = message.split('`').nth(1).unwrap_or("?").to_string();
        MergeError::Key { file: path.into(), key, problem: format!("cannot be read: {message}") }.into()
    })
}
