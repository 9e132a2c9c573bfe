//! The random part of a record, drawn in a fixed order from its own streams.

use std::f64::consts::PI;

use nalgebra::DMatrix;
use ndarray::Array2;
use rand_chacha::ChaCha12Rng;
use rand_distr::{Distribution, StandardNormal, StudentT};

use crate::INPUTS;
use crate::config::{NoiseConfig, TrussConfig};
use crate::covariance;
use crate::plant::Truss;
use crate::state_space::multiply_add;
use crate::streams::{Purpose, stream};

/// The noise of one record.
pub(crate) struct Noise {
    amplifier: (f64, ChaCha12Rng),
    ambient: (DMatrix<f64>, ChaCha12Rng),
    start: (DMatrix<f64>, ChaCha12Rng),
    sensor: SensorNoise,
    /// Number of inputs whose amplifiers are on: the first ones.
    inputs: usize,
}

impl Noise {
    pub(crate) fn new(config: &TrussConfig, truss: &Truss, repeat: usize) -> Self {
        let rng = |purpose| stream(config.seed, purpose, repeat);
        Self {
            amplifier: (config.noise.amplifier_rms_v, rng(Purpose::Amplifier)),
            ambient: (covariance::square_root(&truss.noise.state), rng(Purpose::Ambient)),
            start: (covariance::square_root(&truss.noise.at_rest), rng(Purpose::Start)),
            sensor: SensorNoise::new(config, repeat),
            inputs: INPUTS,
        }
    }

    /// Returns the same noise with only the first inputs' amplifiers on.
    pub(crate) fn of_inputs(self, inputs: usize) -> Self {
        Self { inputs, ..self }
    }

    /// Adds the motion with which a record starts.
    pub(crate) fn start(&mut self, x: &mut [f64]) {
        add_coloured(&mut self.start, x);
    }

    /// Adds the response of the state to the ambient force over a sample.
    pub(crate) fn ambient(&mut self, x: &mut [f64]) {
        add_coloured(&mut self.ambient, x);
    }

    /// Adds the noise of the amplifiers that are on, and sets the inputs of the others to zero.
    pub(crate) fn amplifier(&mut self, u: &mut [f64; INPUTS]) {
        // Noise is drawn for all inputs, so that the amplifiers that are on have the same noise whatever the others
        // do.
        add_white(&mut self.amplifier, u);
        u[self.inputs..].fill(0.0);
    }

    /// Adds the sensors' noise to all samples of a record.
    pub(crate) fn sensor(&mut self, outputs: &mut Array2<f64>) {
        self.sensor.add(outputs);
    }
}

/// White Gaussian noise with, where the config asks for them, a coloured and a heavy-tailed part.
struct SensorNoise {
    config: NoiseConfig,
    /// The pole of the coloured part's filter.
    pole: f64,
    white: (f64, ChaCha12Rng),
    coloured: ChaCha12Rng,
    heavy: ChaCha12Rng,
}

/// Degrees of freedom of the heavy-tailed part: the smallest whole number with a finite variance.
const FREEDOM: f64 = 3.0;

impl SensorNoise {
    fn new(config: &TrussConfig, repeat: usize) -> Self {
        let noise = &config.noise;
        let rng = |purpose| stream(config.seed, purpose, repeat);
        let white = noise.sensor_rms_v * (1.0 - noise.coloured_share - noise.heavy_share).max(0.0).sqrt();
        Self {
            config: noise.clone(),
            pole: (-2.0 * PI * noise.coloured_hz / config.sample_rate_hz).exp(),
            white: (white, rng(Purpose::Sensor)),
            coloured: rng(Purpose::ColouredNoise),
            heavy: rng(Purpose::HeavyNoise),
        }
    }

    fn add(&mut self, outputs: &mut Array2<f64>) {
        // The stream is drawn sample by sample.
        outputs.iter_mut().for_each(|y| add_white(&mut self.white, std::slice::from_mut(y)));
        if self.config.coloured_share > 0.0 {
            self.add_filtered(outputs);
        }
        if self.config.heavy_share > 0.0 {
            let scale = self.config.sensor_rms_v * (self.config.heavy_share * (FREEDOM - 2.0) / FREEDOM).sqrt();
            let law = StudentT::new(FREEDOM).expect("the degrees of freedom are positive");
            outputs.iter_mut().for_each(|y| *y += scale * law.sample(&mut self.heavy));
        }
    }

    /// Adds white noise through one pole, which is in its stationary state from the first sample on.
    fn add_filtered(&mut self, outputs: &mut Array2<f64>) {
        let rms = self.config.sensor_rms_v * self.config.coloured_share.sqrt();
        let fresh = (1.0 - self.pole * self.pole).sqrt();
        for mut channel in outputs.columns_mut() {
            let mut state: f64 = StandardNormal.sample(&mut self.coloured);
            for y in &mut channel {
                *y += rms * state;
                let draw: f64 = StandardNormal.sample(&mut self.coloured);
                state = self.pole * state + fresh * draw;
            }
        }
    }
}

/// Adds white noise, each value with the given standard deviation.
fn add_white((std, rng): &mut (f64, ChaCha12Rng), values: &mut [f64]) {
    for value in values {
        let draw: f64 = StandardNormal.sample(rng);
        *value += *std * draw;
    }
}

/// Adds a Gaussian vector whose covariance has the given square root.
fn add_coloured((root, rng): &mut (DMatrix<f64>, ChaCha12Rng), values: &mut [f64]) {
    let draws: Vec<f64> = (0..values.len()).map(|_| StandardNormal.sample(rng)).collect();
    multiply_add(root, &draws, values);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The variance, the correlation of neighbours and the tails of each mixture are those of its parts.
    #[test]
    fn each_part_has_its_share_of_the_variance() {
        for (coloured_share, heavy_share) in [(0.0, 0.0), (0.5, 0.0), (0.0, 0.5), (0.4, 0.3)] {
            let noise = NoiseConfig { sensor_rms_v: 2.0, coloured_share, heavy_share, ..NoiseConfig::default() };
            let config = TrussConfig { noise, ..TrussConfig::default() };
            let mut samples = Array2::zeros((200_000, 1));
            SensorNoise::new(&config, 0).add(&mut samples);
            let mean = |of: &dyn Fn(usize) -> f64| (1..samples.nrows()).map(of).sum::<f64>() / 199_999.0;
            let variance = mean(&|k| samples[(k, 0)].powi(2));
            let next = mean(&|k| samples[(k, 0)] * samples[(k - 1, 0)]) / variance;
            let far = mean(&|k| f64::from(samples[(k, 0)].abs() > 5.0 * variance.sqrt()));
            assert!((variance / 4.0 - 1.0).abs() < 0.05, "{variance}");
            let pole = (-2.0 * PI * config.noise.coloured_hz / config.sample_rate_hz).exp();
            assert!((next - coloured_share * pole).abs() < 0.02, "{next}");
            // For a Gaussian, the share is 6e-7.
            assert_eq!(far > 1e-4, heavy_share > 0.0, "{far}");
        }
    }
}
