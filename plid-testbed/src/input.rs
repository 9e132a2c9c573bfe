//! The command before the DAC.

use std::f64::consts::PI;

use ndarray::{Array2, ArrayView2};
use rand_chacha::ChaCha12Rng;
use rand_distr::{Distribution, StandardNormal, Uniform};

use crate::INPUTS;
use crate::butterworth::Butterworth;
use crate::config::{Chirp, InputConfig, Multisine, TrussConfig, WhiteNoise, not_negative, positive, within};
use crate::error::TestbedError;
use crate::streams::{Purpose, stream};

/// Returns the command of a config: K x m, V.
pub(crate) fn command(config: &TrussConfig) -> Result<Array2<f64>, TestbedError> {
    let samples = config.samples()?;
    let rate = config.sample_rate_hz;
    let channel: Box<dyn Fn(usize) -> Vec<f64>> = match &config.input {
        InputConfig::Zero => Box::new(|_| vec![0.0; samples]),
        InputConfig::WhiteNoise(c) => {
            check_levels("input.white-noise.level_rms_v", &c.level_rms_v)?;
            below_nyquist("input.white-noise.cutoff_hz", c.cutoff_hz, rate)?;
            Box::new(|j| white_noise(c, config.seed, j, samples, rate))
        }
        InputConfig::Multisine(c) => {
            check_levels("input.multisine.level_rms_v", &c.level_rms_v)?;
            within("input.multisine.period_samples", c.period_samples, 2, 10_000_000)?;
            let lines = lines(c, rate)?;
            Box::new(move |j| multisine(c, &lines, config.seed, j, samples))
        }
        InputConfig::Chirp(c) => {
            check_levels("input.chirp.level_rms_v", &c.level_rms_v)?;
            below_nyquist("input.chirp.start_hz", c.start_hz, rate)?;
            below_nyquist("input.chirp.end_hz", c.end_hz, rate)?;
            Box::new(|j| chirp(c, j, samples, rate))
        }
    };
    let mut command = Array2::zeros((samples, INPUTS));
    for j in 0..INPUTS {
        command.column_mut(j).iter_mut().zip(channel(j)).for_each(|(to, value)| *to = value);
    }
    Ok(command)
}

/// Checks an input given as an array.
pub(crate) fn check_given(input: ArrayView2<f64>) -> Result<(), TestbedError> {
    let (rows, columns) = input.dim();
    if rows == 0 || columns != INPUTS {
        return Err(TestbedError::InputShape { rows, columns });
    }
    match input.indexed_iter().find(|(_, value)| !value.is_finite()) {
        Some(((sample, channel), &value)) => Err(TestbedError::InputNotFinite { sample, channel, value }),
        None => Ok(()),
    }
}

fn check_levels(key: &'static str, levels: &[f64]) -> Result<(), TestbedError> {
    levels.iter().try_for_each(|level| not_negative(key, *level))
}

fn below_nyquist(key: &'static str, value: f64, rate: f64) -> Result<(), TestbedError> {
    positive(key, value)?;
    let nyquist_hz = rate / 2.0;
    if value < nyquist_hz { Ok(()) } else { Err(TestbedError::AboveNyquist { key, value, nyquist_hz }) }
}

fn white_noise(config: &WhiteNoise, seed: u64, channel: usize, samples: usize, rate: f64) -> Vec<f64> {
    let rng = stream(seed, Purpose::Input, channel);
    low_passed(config.level_rms_v[channel], config.cutoff_hz, rng, samples, rate)
}

/// Returns white noise through the low-pass filter. The filter runs for 50 periods of its cut-off before the record
/// begins, so the record is stationary.
pub(crate) fn low_passed(
    level_rms_v: f64,
    cutoff_hz: f64,
    mut rng: ChaCha12Rng,
    samples: usize,
    rate: f64,
) -> Vec<f64> {
    let mut filter = Butterworth::low_pass(3, cutoff_hz, rate);
    let mut next = || filter.filter(StandardNormal.sample(&mut rng));
    let run_in = (50.0 * rate / cutoff_hz).ceil() as usize;
    (0..run_in).for_each(|_| {
        next();
    });
    scaled_to((0..samples).map(|_| next()).collect(), level_rms_v)
}

/// Returns the multiples of the base frequency that lie in the band and below half the sample rate.
fn lines(config: &Multisine, rate: f64) -> Result<Vec<usize>, TestbedError> {
    let [low_hz, high_hz] = config.band_hz;
    let key = "input.multisine.band_hz";
    not_negative(key, low_hz)?;
    below_nyquist(key, high_hz, rate)?;
    let spacing_hz = rate / config.period_samples as f64;
    let lines: Vec<usize> = (1..config.period_samples.div_ceil(2))
        .filter(|line| (low_hz..=high_hz).contains(&(*line as f64 * spacing_hz)))
        .collect();
    if lines.is_empty() { Err(TestbedError::NoLines { key, spacing_hz, low_hz, high_hz }) } else { Ok(lines) }
}

fn multisine(config: &Multisine, lines: &[usize], seed: u64, channel: usize, samples: usize) -> Vec<f64> {
    let mut rng = stream(seed, Purpose::Input, channel);
    let angle = Uniform::new(0.0, 2.0 * PI).expect("an interval of positive length");
    let phases: Vec<(f64, f64)> = lines.iter().map(|_| angle.sample(&mut rng).sin_cos()).collect();
    let period = config.period_samples;
    let circle: Vec<(f64, f64)> = (0..period).map(|k| (2.0 * PI * k as f64 / period as f64).sin_cos()).collect();
    let amplitude = config.level_rms_v[channel] * (2.0 / lines.len() as f64).sqrt();
    let one_period: Vec<f64> = (0..period.min(samples))
        .map(|k| {
            let sum: f64 = lines
                .iter()
                .zip(&phases)
                .map(|(line, (phase_sin, phase_cos))| {
                    let (sin, cos) = circle[(k * line) % period];
                    cos * phase_cos - sin * phase_sin
                })
                .sum();
            amplitude * sum
        })
        .collect();
    (0..samples).map(|k| one_period[k % period]).collect()
}

fn chirp(config: &Chirp, channel: usize, samples: usize, rate: f64) -> Vec<f64> {
    let duration_s = samples as f64 / rate;
    let sine = |k: usize| {
        let t = k as f64 / rate;
        let sweep = (config.end_hz - config.start_hz) / duration_s;
        (2.0 * PI * (config.start_hz + sweep * t / 2.0) * t).sin()
    };
    scaled_to((0..samples).map(sine).collect(), config.level_rms_v[channel])
}

/// Scales the signal to the requested RMS over its whole length; a signal of zeros stays one.
pub(crate) fn scaled_to(mut signal: Vec<f64>, rms: f64) -> Vec<f64> {
    let mean_square = signal.iter().map(|v| v * v).sum::<f64>() / signal.len() as f64;
    if mean_square > 0.0 {
        let scale = rms / mean_square.sqrt();
        signal.iter_mut().for_each(|v| *v *= scale);
    }
    signal
}
