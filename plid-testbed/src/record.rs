//! One record: the chain from the DAC's voltage to the ADC's.

use nalgebra::DMatrix;
use ndarray::{Array2, ArrayView2};
use rand_chacha::ChaCha12Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::config::TrussConfig;
use crate::converter::Converter;
use crate::covariance;
use crate::effects::structure_effects;
use crate::error::TestbedError;
use crate::integrator::Integrator;
use crate::plant::Truss;
use crate::state_space::multiply_add;
use crate::streams::{Purpose, stream};
use crate::{INPUTS, OUTPUTS};

/// Beyond this a motion in V is no motion of any truss.
const UNBOUNDED_V: f64 = 1e6;

/// The random part of a record: draws in a fixed order from streams of its own.
pub(crate) struct Noise {
    amplifier: (f64, ChaCha12Rng),
    sensor: (f64, ChaCha12Rng),
    ambient: (DMatrix<f64>, ChaCha12Rng),
    start: (DMatrix<f64>, ChaCha12Rng),
}

impl Noise {
    pub(crate) fn new(config: &TrussConfig, truss: &Truss, repeat: usize) -> Self {
        let rng = |purpose| stream(config.seed, purpose, repeat);
        Self {
            amplifier: (config.noise.amplifier_rms_v, rng(Purpose::Amplifier)),
            sensor: (config.noise.sensor_rms_v, rng(Purpose::Sensor)),
            ambient: (covariance::square_root(&truss.noise.state), rng(Purpose::Ambient)),
            start: (covariance::square_root(&truss.noise.at_rest), rng(Purpose::Start)),
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

/// Outputs before the ADC (K x p) for commands as the DAC gives them (K x m). Without noise, the structure starts
/// motionless; with it, as the ambient force left it. An effect's clock runs on from the repeats before.
pub(crate) fn record(
    config: &TrussConfig,
    truss: &Truss,
    commands: ArrayView2<f64>,
    repeat: usize,
    mut noise: Option<Noise>,
) -> Result<Array2<f64>, TestbedError> {
    let effects = structure_effects(&config.effects, truss);
    let mut integrator = Integrator::new(truss, effects, config.effects.steps_per_sample);
    let samples = commands.nrows();
    let mut outputs = Array2::zeros((samples, OUTPUTS));
    let mut x = vec![0.0; truss.discrete.states()];
    if let Some(noise) = &mut noise {
        add_coloured(&mut noise.start, &mut x);
    }
    for k in 0..samples {
        let mut y = [0.0; OUTPUTS];
        multiply_add(&truss.discrete.c, &x, &mut y);
        if y.iter().any(|v| v.is_nan() || v.abs() > UNBOUNDED_V) {
            return Err(TestbedError::Diverged { sample: k, repeat });
        }
        let mut u: [f64; INPUTS] = std::array::from_fn(|j| commands[(k, j)]);
        if let Some(noise) = &mut noise {
            add_white(&mut noise.sensor, &mut y);
            add_white(&mut noise.amplifier, &mut u);
        }
        outputs.row_mut(k).iter_mut().zip(y).for_each(|(to, value)| *to = value);
        let t_s = (repeat * samples + k) as f64 / truss.sample_rate_hz;
        integrator.advance(&mut x, &u, t_s);
        if let Some(noise) = &mut noise {
            // Exact for the linear structure; an effect meets the ambient force's motion at the next sample.
            add_coloured(&mut noise.ambient, &mut x);
        }
    }
    Ok(outputs)
}

/// Converts every channel; also how many samples of each were clipped.
pub(crate) fn convert(converter: Converter, mut signal: Array2<f64>) -> (Array2<f64>, Vec<usize>) {
    let mut clipped = vec![0; signal.ncols()];
    for ((_, channel), value) in signal.indexed_iter_mut() {
        let (coded, clips) = converter.convert(*value);
        *value = coded;
        clipped[channel] += usize::from(clips);
    }
    (signal, clipped)
}
