//! The truss as seen in the paper: one input-output pair, five modes, and the errors of a model against the true plant.

use nalgebra::{Complex, DMatrix};
use plid_lab::experiment::{Experiment, NoiseSource};
use plid_model::{FrequencyResponse, Model, find_peak};
use plid_report::{FrfCurve, FrfPlot, frf_plot};
use plid_testbed::{InputConfig, TrussConfig};

use crate::claim::Result;

/// The paper's sensor 2, counted from 0.
pub const SENSOR: usize = 1;
/// The paper's actuator 1, counted from 0.
pub const ACTUATOR: usize = 0;
/// The five dominant modes in Hz.
pub const MODES_HZ: [f64; 5] = [136.0, 168.0, 186.0, 212.0, 243.0];
/// The names of these modes in tables.
const MODE_NAMES: [&str; 5] = ["136 Hz", "168 Hz", "186 Hz", "212 Hz", "243 Hz"];
/// The frequency band of the paper's figures.
pub const BAND_HZ: [f64; 2] = [50.0, 300.0];
/// A peak whose height is off by more than this counts as missed. It is a factor of two in power, the usual measure of
/// a resonance.
pub const CLOSE_DB: f64 = 3.0;
/// Relative half-width of the interval in which the peak of a mode is searched for.
const WIDTH: f64 = 0.02;

/// Returns the truss of an experiment.
///
/// # Panics
/// Panics if its data are files, which is a fault of the built-in config.
pub fn truss_of(experiment: &mut Experiment) -> &mut TrussConfig {
    &mut experiment.data.testbed.as_mut().expect("the experiment has a testbed").truss
}

/// Returns the experiment with this many training samples.
pub fn with_samples(experiment: &Experiment, samples: usize) -> Experiment {
    let mut other = experiment.clone();
    let share = other.validation.training_share;
    let truss = truss_of(&mut other);
    truss.duration_s = samples as f64 / share / truss.sample_rate_hz;
    other
}

/// Returns the experiment with another number of states and another seed.
pub fn with_seed(experiment: &Experiment, states: usize, seed: u64) -> Experiment {
    let mut other = experiment.clone();
    other.structure.states = Some(states);
    truss_of(&mut other).seed = seed;
    other
}

/// Returns the source of the covariances in words.
pub fn covariances(noise: NoiseSource) -> &'static str {
    match noise {
        NoiseSource::PaperLiteral => "paper's covariances",
        NoiseSource::PaperSquared => "paper's covariances squared",
        _ => "tuned covariances",
    }
}

/// Returns the comparisons of the paper with both readings of its covariances, each as a name, the number of averaged
/// repeats, and the covariances.
pub fn with_and_without_averages(averages: usize) -> [(&'static str, usize, NoiseSource); 4] {
    [
        ("paper's covariances, one record", 1, NoiseSource::PaperLiteral),
        ("paper's covariances, ten averages", averages, NoiseSource::PaperLiteral),
        ("tuned covariances, one record", 1, NoiseSource::Tuned),
        ("tuned covariances, ten averages", averages, NoiseSource::Tuned),
    ]
}

/// Returns the true plant from the inputs in use to all outputs.
///
/// # Errors
/// Returns an error for a config that the testbed rejects.
pub fn truth(experiment: &Experiment) -> Result<Model> {
    let mut experiment = experiment.clone();
    let used = experiment.data.inputs.clone();
    let plant = plid_testbed::truss(truss_of(&mut experiment))?;
    let mut model =
        Model::new(plant.sample_rate_hz, plant.discrete.a, plant.discrete.b, plant.discrete.c, plant.discrete.d)?;
    if !used.is_empty() {
        let columns: Vec<usize> = used.iter().filter_map(|name| model.inputs.iter().position(|n| n == name)).collect();
        model.b = model.b.select_columns(&columns);
        model.d = model.d.select_columns(&columns);
        model.inputs = used;
    }
    Ok(model)
}

/// A mode in one input-output pair: the true peak, and that of the model if it has one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ModeRow {
    /// Frequency of the mode in Hz.
    pub mode_hz: f64,
    /// The true peak: frequency in Hz and magnitude in dB.
    pub truth: (f64, f64),
    /// The peak of the model: frequency in Hz and magnitude in dB; `None` without a maximum within 2 % of the mode.
    pub model: Option<(f64, f64)>,
}

impl ModeRow {
    /// Returns the height of the model's peak minus that of the true peak in dB, or NaN without a peak.
    pub fn db_off(&self) -> f64 {
        self.model.map_or(f64::NAN, |(_, db)| db - self.truth.1)
    }

    /// Whether the peak exists and is within 3 dB.
    pub fn is_close(&self) -> bool {
        self.db_off().abs() <= CLOSE_DB
    }

    /// Returns the error of the height as a table shows it.
    pub fn words(&self) -> String {
        match self.model {
            None => "no peak".into(),
            Some(_) if self.is_close() => format!("{:+.2}", self.db_off()),
            Some(_) => format!("{:+.2} (missed)", self.db_off()),
        }
    }
}

/// Returns the five modes in one input-output pair.
///
/// # Errors
/// Returns an error for a model whose poles cannot be computed.
pub fn modes(truth: &Model, model: &Model, output: usize, input: usize) -> Result<Vec<ModeRow>> {
    let row = |&mode_hz: &f64| {
        let peak = find_peak(truth, output, input, mode_hz, WIDTH * mode_hz)?;
        let found = find_peak(model, output, input, mode_hz, WIDTH * mode_hz)?;
        let model = found.interior.then_some((found.hz, found.db));
        Ok(ModeRow { mode_hz, truth: (peak.hz, peak.db), model })
    };
    MODES_HZ.iter().map(row).collect()
}

/// Returns the five modes in every pair whose true response has a maximum there.
///
/// # Errors
/// Returns the errors of [`modes`].
pub fn modes_of_all_pairs(truth: &Model, model: &Model) -> Result<Vec<ModeRow>> {
    let mut rows = Vec::new();
    for j in 0..truth.m() {
        for i in 0..truth.p() {
            for row in modes(truth, model, i, j)? {
                if find_peak(truth, i, j, row.mode_hz, WIDTH * row.mode_hz)?.interior {
                    rows.push(row);
                }
            }
        }
    }
    Ok(rows)
}

/// Returns evenly spaced frequencies of a band, close enough for the narrowest mode, which is 1 Hz wide.
fn grid([low, high]: [f64; 2]) -> Vec<f64> {
    let count = ((high - low) / 0.25).round() as usize;
    (0..=count).map(|k| low + (high - low) * k as f64 / count as f64).collect()
}

/// Returns the RMS of the difference of two responses over a band and all pairs, relative to that of the true response.
pub fn band_error(truth: &Model, model: &Model, band: [f64; 2]) -> f64 {
    let (truth, model) = (FrequencyResponse::of(truth), FrequencyResponse::of(model));
    let power = |h: &DMatrix<Complex<f64>>| h.iter().map(|x| x.norm_sqr()).sum::<f64>();
    let (mut off, mut all) = (0.0, 0.0);
    for hz in grid(band) {
        let expected = truth.at(hz);
        off += power(&(model.at(hz) - &expected));
        all += power(&expected);
    }
    (off / all).sqrt()
}

/// Returns the curve of one pair over the paper's band.
pub fn curve(model: &Model, output: usize, input: usize) -> FrfCurve {
    let response = FrequencyResponse::of(model);
    let frequency_hz = grid(BAND_HZ);
    FrfCurve {
        response: frequency_hz.iter().map(|&hz| response.at(hz)[(output, input)]).collect(),
        frequency_hz,
        std: None,
    }
}

/// Plots the identified and the true response of one pair.
pub fn overlay(truth: &Model, model: &Model, output: usize, input: usize) -> String {
    frf_plot(&FrfPlot {
        unit: "V/V".into(),
        identified: Some(curve(model, output, input)),
        truth: Some(curve(truth, output, input)),
        range_hz: Some((BAND_HZ[0], BAND_HZ[1])),
        ..FrfPlot::default()
    })
}

/// Returns the RMS of the three outputs without a command, in V.
///
/// # Errors
/// Returns an error for a config that the testbed rejects.
pub fn noise_floor(experiment: &Experiment) -> Result<f64> {
    let mut config = truss_of(&mut experiment.clone()).clone();
    config.input = InputConfig::Zero;
    config.repeats = 1;
    let simulation = plid_testbed::simulate(&config)?;
    Ok(plid_model::signal::rms(simulation.outputs[0].iter().copied()))
}

/// Returns the mean and the standard deviation of single values.
pub fn mean_and_spread(values: &[f64]) -> (f64, f64) {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let square = values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
    (mean, square.sqrt())
}

/// Returns the columns of a table: the first ones, and one for the height of each mode in decibels off the true one.
pub fn with_mode_columns<'a>(first: &[(&'a str, &'a str)]) -> Vec<(&'a str, &'a str)> {
    first.iter().copied().chain(MODE_NAMES.map(|name| (name, "dB off"))).collect()
}
