//! What an experiment is: a strict TOML file that names data, preparation, structure, noise, variant and validation.

mod config;
mod parse;

pub use config::{
    Covariance, DataConfig, Experiment, IdentificationConfig, IndicesChoice, NoiseConfig, NoiseReading, NoiseSource,
    Refinement, StartConfig, StructureConfig, StructureKind, TestbedData, ValidationConfig,
};
pub use parse::{ConfigError, from_toml, from_toml_checked, read, read_checked, to_toml};
