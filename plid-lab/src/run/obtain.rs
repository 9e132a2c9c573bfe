//! The data of an experiment, read from files or simulated.

use std::collections::BTreeMap;
use std::path::Path;

use ndarray::{Array2, ArrayView1};
use serde::{Deserialize, Serialize};

use super::error::{RunError, setting};
use crate::experiment::{DataConfig, Experiment};
use plid_data::prepare::repeats::Repeats;
use plid_data::{self as data, MissingPolicy, Record};
use plid_model::Model;
use plid_model::signal::rms;

/// A data file used in a run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Source {
    /// The file name as given in the config.
    pub file: String,
    /// SHA-256 of its bytes.
    pub sha256: String,
}

/// The true plant of simulated data.
#[derive(Clone, Debug)]
pub struct Truth {
    /// Its discrete-time model, in volts.
    pub model: Model,
    /// Its noise-free response to the commands (K x p).
    pub noise_free: Array2<f64>,
    /// The frequencies of its dominant modes in Hz.
    pub dominant_hz: Vec<f64>,
}

impl Truth {
    /// Returns the plant with the chosen outputs, and with all inputs in another order. Outputs and inputs are each
    /// given by their indices and the names of all channels.
    fn with_channels(
        self,
        (use_inputs, inputs): (&[usize], &[String]),
        (use_outputs, outputs): (&[usize], &[String]),
    ) -> Self {
        Self {
            model: Model {
                b: self.model.b.select_columns(use_inputs),
                c: self.model.c.select_rows(use_outputs),
                d: self.model.d.select_rows(use_outputs).select_columns(use_inputs),
                inputs: use_inputs.iter().map(|&j| inputs[j].clone()).collect(),
                outputs: use_outputs.iter().map(|&i| outputs[i].clone()).collect(),
                ..self.model
            },
            noise_free: self.noise_free.select(ndarray::Axis(1), use_outputs),
            dominant_hz: self.dominant_hz,
        }
    }
}

/// Records and their origin.
#[derive(Clone, Debug)]
pub struct Obtained {
    /// The records, one per file or per repeat of the testbed.
    pub records: Vec<Record>,
    /// The files read.
    pub sources: Vec<Source>,
    /// The true plant, if the data are simulated.
    pub truth: Option<Truth>,
    /// Warnings for the reader.
    pub warnings: Vec<String>,
    /// RMS of every column of the data about its mean, whether the run uses the column or not. It is the largest
    /// value over the records.
    pub channel_rms: BTreeMap<String, f64>,
}

/// Reads or simulates the data. Paths are relative to `base`. Repeats of the testbed are averaged unless the experiment
/// specifies otherwise.
pub(crate) fn obtain(experiment: &mut Experiment, base: &Path) -> Result<Obtained, RunError> {
    match &experiment.data.testbed {
        None => read(&experiment.data, base),
        Some(_) => {
            let obtained = simulate(&experiment.data, base)?;
            experiment.data.input_unit.get_or_insert("V".into());
            experiment.data.output_unit.get_or_insert("V".into());
            if obtained.records.len() > 1 && experiment.preparation.repeats.is_none() {
                // The DAC outputs identical codes in every repeat.
                experiment.preparation.repeats = Some(Repeats { period: None, skip: 0, tolerance: 1e-9 });
            }
            Ok(obtained)
        }
    }
}

fn read(config: &DataConfig, base: &Path) -> Result<Obtained, RunError> {
    let (mut records, mut sources, mut channel_rms) = (Vec::new(), Vec::new(), BTreeMap::new());
    let mut warnings: Vec<data::Warning> = Vec::new();
    // Only one table is held in memory at a time.
    for file in &config.files {
        let table = data::read(&base.join(file), config.variable.as_deref())?;
        let (record, more) =
            data::select(&table, &config.inputs, &config.outputs, config.sample_rate_hz, config.missing)?;
        records.push(record);
        let new: Vec<_> = more.into_iter().filter(|warning| !warnings.contains(warning)).collect();
        warnings.extend(new);
        for (name, size) in largest_rms(table.names.iter().zip(table.columns.columns())) {
            let entry = channel_rms.entry(name).or_insert(0.0);
            *entry = size.max(*entry);
        }
        sources.push(Source { file: file.display().to_string(), sha256: table.sha256 });
    }
    data::require_alike(&records)?;
    let warnings = warnings.iter().map(ToString::to_string).collect();
    Ok(Obtained { records, sources, truth: None, warnings, channel_rms })
}

/// Returns the RMS about the mean by channel name; NaN marks a missing sample.
fn largest_rms<'a>(columns: impl Iterator<Item = (&'a String, ArrayView1<'a, f64>)>) -> BTreeMap<String, f64> {
    let mut largest = BTreeMap::new();
    for (name, column) in columns {
        let there = || column.iter().copied().filter(|x| x.is_finite());
        let mean = there().sum::<f64>() / there().count().max(1) as f64;
        let size = rms(there().map(|x| x - mean));
        let entry = largest.entry(name.clone()).or_insert(0.0);
        *entry = size.max(*entry);
    }
    largest
}

/// Returns the true plant of a simulation with all its channels.
fn true_plant(simulation: &plid_testbed::Simulation) -> Result<Truth, RunError> {
    let plant = &simulation.truth;
    let state_space = &plant.discrete;
    let model = Model::new(
        simulation.sample_rate_hz,
        state_space.a.clone(),
        state_space.b.clone(),
        state_space.c.clone(),
        state_space.d.clone(),
    )?;
    let dominant = plant.modes.iter().filter(|mode| mode.group == plid_testbed::ModeGroup::Dominant);
    Ok(Truth {
        model,
        noise_free: simulation.noise_free.clone(),
        dominant_hz: dominant.map(|mode| mode.frequency_hz).collect(),
    })
}

/// Returns the indices of the wanted channels among all channels, or those of all channels if none is named.
fn choose(wanted: &[String], all: &[String], key: &'static str) -> Result<Vec<usize>, RunError> {
    let found = wanted.iter().map(|name| {
        let place = all.iter().position(|n| n == name);
        place.ok_or_else(|| setting(key, format!("the truss has {}, not `{name}`", all.join(", "))))
    });
    if wanted.is_empty() { Ok((0..all.len()).collect()) } else { found.collect() }
}

fn simulate(config: &DataConfig, base: &Path) -> Result<Obtained, RunError> {
    let Some(testbed) = &config.testbed else { unreachable!("called only with a testbed") };
    let names = |prefix: &str, count: usize| -> Vec<String> { (1..=count).map(|i| format!("{prefix}{i}")).collect() };
    let (inputs, outputs) = (names("u", plid_testbed::INPUTS), names("y", plid_testbed::OUTPUTS));
    let mut sources = Vec::new();
    let simulation = match &testbed.input_file {
        None => plid_testbed::simulate(&testbed.truss)?,
        Some(file) => {
            let table = data::read(&base.join(file), config.variable.as_deref())?;
            sources.push(Source { file: file.display().to_string(), sha256: table.sha256.clone() });
            let command = data::channels(&table, &inputs, MissingPolicy::Error)?;
            plid_testbed::simulate_input(&testbed.truss, command.view())?
        }
    };
    let (use_inputs, use_outputs) =
        (choose(&config.inputs, &inputs, "inputs")?, choose(&config.outputs, &outputs, "outputs")?);
    let pick = |array: &Array2<f64>, columns: &[usize]| array.select(ndarray::Axis(1), columns);
    let records = simulation
        .outputs
        .iter()
        .map(|measured| Record {
            sample_rate_hz: simulation.sample_rate_hz,
            input_names: use_inputs.iter().map(|&j| inputs[j].clone()).collect(),
            output_names: use_outputs.iter().map(|&i| outputs[i].clone()).collect(),
            inputs: pick(&simulation.commands, &use_inputs),
            outputs: pick(measured, &use_outputs),
        })
        .collect();
    // If an input is left out, it still affects the outputs, so the true model is no longer a reference.
    let whole = use_inputs.len() == inputs.len();
    let truth = true_plant(&simulation)?;
    let truth = whole.then(|| truth.with_channels((&use_inputs, &inputs), (&use_outputs, &outputs)));
    let repeats = simulation.outputs.iter().flat_map(|measured| outputs.iter().zip(measured.columns()));
    let channel_rms = largest_rms(inputs.iter().zip(simulation.commands.columns()).chain(repeats));
    let warnings = simulation.warnings.iter().map(ToString::to_string).collect();
    Ok(Obtained { records, sources, truth, warnings, channel_rms })
}
