//! One record: the chain from the DAC's voltage to the ADC's.

use nalgebra::DMatrix;
use ndarray::{Array2, ArrayView2, s};
use rand_chacha::ChaCha12Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::config::TrussConfig;
use crate::converter::Converter;
use crate::covariance;
use crate::effects;
use crate::effects::chain::{Chain, Clock};
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
    /// Inputs whose amplifiers are on: the first ones.
    inputs: usize,
}

impl Noise {
    pub(crate) fn new(config: &TrussConfig, truss: &Truss, repeat: usize) -> Self {
        let rng = |purpose| stream(config.seed, purpose, repeat);
        Self {
            amplifier: (config.noise.amplifier_rms_v, rng(Purpose::Amplifier)),
            sensor: (config.noise.sensor_rms_v, rng(Purpose::Sensor)),
            ambient: (covariance::square_root(&truss.noise.state), rng(Purpose::Ambient)),
            start: (covariance::square_root(&truss.noise.at_rest), rng(Purpose::Start)),
            inputs: INPUTS,
        }
    }

    /// The same, but only the first inputs' amplifiers are on.
    pub(crate) fn of_inputs(self, inputs: usize) -> Self {
        Self { inputs, ..self }
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

/// Outputs of a record, and how many samples of each the ADC clipped.
pub(crate) struct Recorded {
    pub outputs: Array2<f64>,
    pub clipped: Vec<usize>,
}

/// Outputs (K x p) of the plant, as its linear effects changed it, for commands as the DAC gives them (K x m). Without noise the
/// structure starts motionless and nothing is converted; with it, it starts as the ambient force left it. Clocks of effects run
/// on from the records before.
pub(crate) fn record(
    config: &TrussConfig,
    truss: &Truss,
    commands: ArrayView2<f64>,
    clock: Clock,
    noise: Option<Noise>,
) -> Result<Recorded, TestbedError> {
    let mut chain = effects::chain(&config.effects, truss, config.seed, clock);
    let mut noise = noise;
    let mut outputs = motion(config, truss, commands, clock, &mut chain, noise.as_mut())?;
    for effect in &mut chain.sensor {
        effect.apply(clock, &mut outputs);
    }
    let mut outputs = outputs.slice_move(s![..commands.nrows(), ..]);
    let mut clipped = vec![0; OUTPUTS];
    if let Some(noise) = &mut noise {
        // Sample by sample: the order in which the stream is drawn.
        outputs.iter_mut().for_each(|y| add_white(&mut noise.sensor, std::slice::from_mut(y)));
        let adc = Converter { step_v: config.converters.step_v, range_v: config.converters.range_v };
        (outputs, clipped) = convert(adc, outputs);
    }
    for effect in &mut chain.codes {
        effect.apply(clock, &mut outputs);
    }
    Ok(Recorded { outputs, clipped })
}

/// The filtered accelerations at the samples; as many more rows as the sensor effects look ahead, without command.
fn motion(
    config: &TrussConfig,
    truss: &Truss,
    commands: ArrayView2<f64>,
    clock: Clock,
    chain: &mut Chain,
    mut noise: Option<&mut Noise>,
) -> Result<Array2<f64>, TestbedError> {
    let mut integrator = Integrator::new(truss, chain, config.effects.steps_per_sample);
    let samples = commands.nrows();
    let states = truss.discrete.states();
    let mut outputs = Array2::zeros((samples + chain.look_ahead, OUTPUTS));
    let mut x = integrator.at_rest();
    if let Some(noise) = &mut noise {
        add_coloured(&mut noise.start, &mut x[..states]);
    }
    for k in 0..samples + chain.look_ahead {
        let mut y = [0.0; OUTPUTS];
        multiply_add(&truss.discrete.c, &x[..states], &mut y);
        if y.iter().any(|v| v.is_nan() || v.abs() > UNBOUNDED_V) {
            return Err(TestbedError::Diverged { sample: k, repeat: clock.record });
        }
        outputs.row_mut(k).iter_mut().zip(y).for_each(|(to, value)| *to = value);
        let mut u: [f64; INPUTS] = std::array::from_fn(|j| if k < samples { commands[(k, j)] } else { 0.0 });
        if let Some(noise) = &mut noise {
            // All are drawn, so that those that are on have the same noise whatever the others do.
            add_white(&mut noise.amplifier, &mut u);
            u[noise.inputs..].fill(0.0);
        }
        integrator.advance(&mut x, u, clock.time_s(k));
        if let Some(noise) = &mut noise {
            // Exact for the linear structure; an effect meets the ambient force's motion at the next sample.
            add_coloured(&mut noise.ambient, &mut x[..states]);
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
