//! A whole experiment: one input, recorded once or several times.

use ndarray::{Array2, ArrayView2};

use crate::config::TrussConfig;
use crate::converter::Converter;
use crate::effects::chain::Clock;
use crate::error::{TestbedError, Warning};
use crate::input;
use crate::noise::Noise;
use crate::plant::{Truss, altered, truss};
use crate::record::{convert, record};

/// The records of an experiment, and the true plant.
#[derive(Clone, Debug)]
pub struct Simulation {
    /// Sample rate, Hz.
    pub sample_rate_hz: f64,
    /// Commands as the DAC gives them (K x m), V; the same in every repeat.
    pub commands: Array2<f64>,
    /// Outputs as the ADC gives them (K x p), V, of each repeat.
    pub outputs: Vec<Array2<f64>>,
    /// Outputs of the first repeat without any noise and before the ADC (K x p), V. Without effects this is the free
    /// run of `truth.discrete`, from rest, on the commands.
    pub noise_free: Array2<f64>,
    /// The plant without the effects.
    pub truth: Truss,
    /// Warnings about these records.
    pub warnings: Vec<Warning>,
}

/// Runs the experiment.
///
/// # Errors
/// Returns an error if a key of the config is wrong, or if an effect makes the structure unstable.
pub fn simulate(config: &TrussConfig) -> Result<Simulation, TestbedError> {
    config.check()?;
    run(config, input::command(config)?)
}

/// Runs the experiment on an input given as an array (K x m, V, before the DAC), in place of the config's `input`; its
/// length replaces `duration_s`.
///
/// # Errors
/// Returns the errors of [`simulate`], and an error if the array is empty, does not have three columns, or contains NaN
/// or infinity.
pub fn simulate_input(config: &TrussConfig, input: ArrayView2<f64>) -> Result<Simulation, TestbedError> {
    input::check_given(input)?;
    crate::config::positive("sample_rate_hz", config.sample_rate_hz)?;
    let duration_s = input.nrows() as f64 / config.sample_rate_hz;
    run(&TrussConfig { duration_s, ..config.clone() }, input.to_owned())
}

fn run(config: &TrussConfig, command: Array2<f64>) -> Result<Simulation, TestbedError> {
    let truth = truss(config)?;
    let converter = Converter { step_v: config.converters.step_v, range_v: config.converters.range_v };
    let mut warnings = truth.warnings.clone();
    let (commands, clipped) = convert(converter, command);
    let clips = |counts: Vec<usize>| counts.into_iter().enumerate().filter(|(_, samples)| *samples > 0);
    warnings.extend(clips(clipped).map(|(channel, samples)| Warning::CommandClipped { channel, samples }));
    let plant = altered(config, &truth);
    let sample_rate_hz = config.sample_rate_hz;
    let clock = |repeat: usize| Clock { record: repeat, start: repeat * commands.nrows(), sample_rate_hz };
    let noise_free = record(config, &plant, commands.view(), clock(0), None)?.outputs;
    let mut outputs = Vec::with_capacity(config.repeats);
    for repeat in 0..config.repeats {
        let noise = Noise::new(config, &plant, repeat);
        let recorded = record(config, &plant, commands.view(), clock(repeat), Some(noise))?;
        let clips = clips(recorded.clipped);
        warnings.extend(clips.map(|(channel, samples)| Warning::OutputClipped { repeat, channel, samples }));
        outputs.push(recorded.outputs);
    }
    Ok(Simulation { sample_rate_hz: config.sample_rate_hz, commands, outputs, noise_free, truth, warnings })
}
