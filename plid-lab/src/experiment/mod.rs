//! An experiment: a strict TOML file that names data, preparation, structure, noise, variant and validation.

mod config;
#[cfg(test)]
mod tests;

use std::path::Path;

pub use config::{
    Covariance, DataConfig, Experiment, IdentificationConfig, IndicesChoice, NoiseConfig, NoiseReading, NoiseSource,
    Refinement, StartConfig, StructureConfig, StructureKind, TestbedData, ValidationConfig,
};
pub use plid_data::config::{ConfigError, from_toml, to_toml};

/// Reads and checks an experiment.
///
/// # Errors
/// Returns a [`ConfigError`] with the file, the line and, for an unknown word, the most similar known word.
pub fn read(path: &Path) -> Result<Experiment, ConfigError> {
    plid_data::config::read_checked(path, Experiment::problems)
}
