//! The noise covariances of a run. They are given, measured, or left to the filter bank, and converted from the
//! data's units to those of the recursion.

use std::path::Path;

use ndarray::Array2;
use plid_core::{Dense, ImplicitModel, NoiseModel, ObservableForm};

use super::error::{RunError, setting};
use crate::experiment::{Covariance, Experiment, NoiseConfig, NoiseReading, NoiseSource};
use plid_data::prepare::converter::converter_step;
use plid_data::prepare::noise::{NoiseCovariance, noise_from_zero_input};
use plid_data::prepare::{Prepared, Step};
use plid_data::{self as data, MissingPolicy, Record};

/// The part of the noise model that is known before the filter bank runs.
pub(super) enum Known {
    /// The complete noise model.
    All(Box<NoiseModel>),
    /// The variances R_ii (if known) and Q_jj of scaled channels.
    Some { sensor: Option<Vec<f64>>, actuator: Vec<f64> },
}

/// The largest RMS of an input at rest, relative to its RMS in the identified record.
const REST: f64 = 1e-3;

/// Returns the noise according to the config, for scaled channels. `raw` are the records before preparation.
pub(super) fn known(
    experiment: &Experiment,
    base: &Path,
    raw: &[Record],
    prepared: &Prepared,
    form: &ObservableForm,
) -> Result<Known, RunError> {
    let config = &experiment.noise;
    let (p, m, n) = (form.outputs(), form.inputs(), form.states());
    let scales = Scales::new(prepared, form);
    let diagonal = |variances: &[f64], scales: &[f64]| -> Vec<f64> {
        variances.iter().zip(scales).map(|(v, s)| v / (s * s)).collect()
    };
    let actuator = match &config.actuator {
        Some(value) => {
            let full = matrix("noise.actuator", value, m, config.read_as)?;
            (0..m).map(|j| full.at(j, j) / prepared.input_scales[j].powi(2)).collect()
        }
        None => vec![0.0; m],
    };
    let kept = retained_power(prepared);
    // Averaging divides the power of noise by the number of repeats.
    let repeats = prepared.repeat_noise.first().map_or(1, |(_, count)| *count) as f64;
    let measured = |variances: Vec<f64>| Known::Some {
        sensor: Some(diagonal(&variances, &prepared.output_scales)),
        actuator: actuator.clone(),
    };
    Ok(match config.from {
        NoiseSource::PaperLiteral => Known::All(Box::new(scales.apply(&NoiseModel::paper_literal(p, m, n)))),
        NoiseSource::PaperSquared => Known::All(Box::new(scales.apply(&NoiseModel::paper_squared(p, m, n)))),
        NoiseSource::Given => {
            let noise = given(config, form)?;
            Known::All(Box::new(scales.apply(&noise)))
        }
        NoiseSource::Tuned => match &config.sensor {
            Some(value) => {
                let full = matrix("noise.sensor", value, p, config.read_as)?;
                measured((0..p).map(|i| full.at(i, i)).collect())
            }
            None => Known::Some { sensor: None, actuator },
        },
        NoiseSource::Repeats => {
            let Some((noise, count)) = prepared.repeat_noise.first() else {
                return Err(setting("noise", "from = \"repeats\" requires repeats in the data"));
            };
            measured(noise.covariance.diag().iter().map(|v| v / *count as f64 * kept).collect())
        }
        NoiseSource::ZeroInput => {
            let noise = at_rest(experiment, base, &raw[0], prepared)?;
            measured(noise.covariance.diag().iter().map(|v| v * kept / repeats).collect())
        }
        NoiseSource::Converter => {
            let variances: Result<Vec<f64>, RunError> = raw[0]
                .outputs
                .columns()
                .into_iter()
                .zip(&raw[0].output_names)
                .map(|(column, name)| match converter_step(column) {
                    Some(step) => Ok(step.variance * kept / repeats),
                    None => Err(setting("noise", format!("output `{name}` has no detectable converter step"))),
                })
                .collect();
            measured(variances?)
        }
    })
}

/// Returns the covariances that the experiment states, in the data's units.
fn given(config: &NoiseConfig, form: &ObservableForm) -> Result<NoiseModel, RunError> {
    let (p, m, n) = (form.outputs(), form.inputs(), form.states());
    let cross = |key, value: &Option<Vec<Vec<f64>>>, rows, columns| match value {
        Some(value) => rectangle(key, value, rows, columns),
        None => Ok(plid_core::Matrix::zeros(rows, columns)),
    };
    let read = |key, value: &Option<Covariance>, size| match value {
        Some(value) => matrix(key, value, size, config.read_as),
        None => Ok(plid_core::Matrix::zeros(size, size)),
    };
    let noise = NoiseModel {
        sensor: read("noise.sensor", &config.sensor, p)?,
        actuator: read("noise.actuator", &config.actuator, m)?,
        state: read("noise.state", &config.state, n)?,
        actuator_sensor: cross("noise.actuator_sensor", &config.actuator_sensor, m, p)?,
        sensor_state: cross("noise.sensor_state", &config.sensor_state, p, n)?,
        actuator_state: cross("noise.actuator_state", &config.actuator_state, m, n)?,
    };
    noise.check(p, m, n).map_err(|e| setting("noise", e))?;
    Ok(noise)
}

/// Returns the noise of a record with inputs at rest, which must have the channels and the rate of `first`.
fn at_rest(
    experiment: &Experiment,
    base: &Path,
    first: &Record,
    prepared: &Prepared,
) -> Result<NoiseCovariance, RunError> {
    let Some(file) = &experiment.noise.zero_input_file else {
        return Err(setting("noise", "from = \"zero-input\" requires `zero_input_file`"));
    };
    let table = data::read(&base.join(file), experiment.data.variable.as_deref())?;
    let rate = Some(first.sample_rate_hz);
    let (rest, _) = data::extract(&table, &first.input_names, &first.output_names, rate, MissingPolicy::Error)?;
    let largest = prepared.input_scales.iter().copied().fold(0.0, f64::max);
    Ok(noise_from_zero_input(&rest, REST * largest)?)
}

/// Returns the fraction of white noise power that decimation retains.
fn retained_power(prepared: &Prepared) -> f64 {
    // An anti-alias filter retains approximately the remaining band.
    prepared
        .steps
        .iter()
        .map(|step| match step {
            Step::Decimated(plan) => 1.0 / plan.ratio as f64,
            _ => 1.0,
        })
        .product()
}

/// The scales of outputs, inputs and states; a state has the scale of its block's output.
pub(super) struct Scales {
    outputs: Vec<f64>,
    inputs: Vec<f64>,
    states: Vec<f64>,
}

impl Scales {
    pub(super) fn new(prepared: &Prepared, form: &ObservableForm) -> Self {
        let blocks = form.indices().iter().zip(&prepared.output_scales);
        Self {
            outputs: prepared.output_scales.clone(),
            inputs: prepared.input_scales.clone(),
            states: blocks.flat_map(|(&count, &scale)| vec![scale; count]).collect(),
        }
    }

    /// Converts noise from the data's units to scaled channels.
    fn apply(&self, noise: &NoiseModel) -> NoiseModel {
        let over = |matrix: &Dense<f64>, rows: &[f64], columns: &[f64]| {
            Dense::from_fn(matrix.rows(), matrix.columns(), |i, j| matrix.at(i, j) / (rows[i] * columns[j]))
        };
        NoiseModel {
            sensor: over(&noise.sensor, &self.outputs, &self.outputs),
            actuator: over(&noise.actuator, &self.inputs, &self.inputs),
            state: over(&noise.state, &self.states, &self.states),
            actuator_sensor: over(&noise.actuator_sensor, &self.inputs, &self.outputs),
            sensor_state: over(&noise.sensor_state, &self.outputs, &self.states),
            actuator_state: over(&noise.actuator_state, &self.inputs, &self.states),
        }
    }
}

fn matrix(key: &'static str, value: &Covariance, size: usize, reading: NoiseReading) -> Result<Dense<f64>, RunError> {
    let square = |x: &f64| if reading == NoiseReading::Rms { x * x } else { *x };
    match value {
        Covariance::Common(x) => Ok(Dense::from_diagonal(&vec![square(x); size])),
        Covariance::Diagonal(list) if list.len() == size => {
            Ok(Dense::from_diagonal(&list.iter().map(square).collect::<Vec<_>>()))
        }
        Covariance::Diagonal(list) => Err(setting(
            key,
            format!(
                "{} values are given, but {size} are \
            needed",
                list.len()
            ),
        )),
        Covariance::Full(_) if reading == NoiseReading::Rms => {
            Err(setting(key, "a whole matrix is a covariance; read_as = \"rms\" takes a number or a list"))
        }
        Covariance::Full(rows) => rectangle(key, rows, size, size),
    }
}

fn rectangle(key: &'static str, rows: &[Vec<f64>], height: usize, width: usize) -> Result<Dense<f64>, RunError> {
    if rows.len() != height || rows.iter().any(|row| row.len() != width) {
        return Err(setting(key, format!("must be {height} rows of {width} numbers")));
    }
    Ok(Dense::from_fn(height, width, |i, j| rows[i][j]))
}

/// Whether prepared outputs contain missing samples, which only some configs permit.
pub(super) fn has_missing(outputs: &Array2<f64>) -> bool {
    outputs.iter().any(|x| x.is_nan())
}
