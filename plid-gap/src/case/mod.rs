//! A gap case: the simulation, the records, and what the engineer knows.

mod config;

use std::path::Path;

use ndarray::Array2;
use plid_lab::data;
use plid_model::Model;

use crate::error::GapError;
use crate::record::{Channels, Record};

pub use config::{CaseConfig, ExcitationKind, RecordConfig, StartKind, Use};

/// A case with its files read.
#[derive(Debug, Clone)]
pub struct Case {
    /// As written.
    pub config: CaseConfig,
    /// The simulation, if one is given.
    pub model: Option<Model>,
    /// In order.
    pub records: Vec<Record>,
    /// What was noticed while reading.
    pub warnings: Vec<String>,
}

impl Case {
    /// Reads a case and its files.
    ///
    /// # Errors
    /// [`GapError`] with file, line, channel or key.
    pub fn read(path: &Path) -> Result<Self, GapError> {
        let config: CaseConfig = plid_lab::experiment::read_checked(path, CaseConfig::problems)?;
        let folder = path.parent().unwrap_or(Path::new("."));
        let model = config.sim.as_ref().map(|sim| Model::read(&folder.join(sim))).transpose()?;
        if let Some(model) = &model {
            check_channels(path, &config, model)?;
        }
        let mut records = Vec::new();
        let mut warnings = Vec::new();
        let mut clock = 0.0;
        for given in &config.record {
            let file = folder.join(&given.file);
            let table = data::read(&file, None)?;
            let (read, more) = data::extract(
                &table,
                &config.inputs,
                &config.outputs,
                Some(config.sample_rate_hz),
                data::MissingPolicy::Nan,
            )?;
            warnings.extend(more.iter().map(|warning| format!("{}: {warning}", given.file)));
            let simulated = match &given.simulated {
                Some(name) => {
                    let table = data::read(&folder.join(name), None)?;
                    Some(columns(&data::channels(&table, &config.outputs, data::MissingPolicy::Error)?))
                }
                None => None,
            };
            let start_s = given.start_s.unwrap_or(clock);
            clock = start_s + read.duration_s();
            records.push(Record {
                name: given.file.clone(),
                excitation: given.excitation(),
                from_rest: given.start == StartKind::Rest,
                start_s,
                held_out: given.r#use == Some(Use::Test),
                u: columns(&read.inputs),
                y: columns(&read.outputs),
                simulated,
            });
        }
        Ok(Self { config, model, records, warnings })
    }
}

/// One channel after the other.
pub fn columns(data: &Array2<f64>) -> Channels {
    data.columns().into_iter().map(|column| column.to_vec()).collect()
}

fn check_channels(path: &Path, config: &CaseConfig, model: &Model) -> Result<(), GapError> {
    let wrong = |key: &str, message: String| GapError::Key { file: path.into(), key: key.into(), message };
    for (key, of_case, of_model) in
        [("inputs", &config.inputs, &model.inputs), ("outputs", &config.outputs, &model.outputs)]
    {
        if of_case != of_model {
            return Err(wrong(
                key,
                format!("{} here, but {} in the simulation", of_case.join(", "), of_model.join(", ")),
            ));
        }
    }
    if (config.sample_rate_hz / model.sample_rate_hz - 1.0).abs() > 1e-6 {
        return Err(wrong(
            "sample_rate_hz",
            format!("{} here, but {} in the simulation", config.sample_rate_hz, model.sample_rate_hz),
        ));
    }
    Ok(())
}
