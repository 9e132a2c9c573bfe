//! One record: the chain from the DAC's voltage to the ADC's.

use ndarray::{Array2, ArrayView2, s};

use crate::config::TrussConfig;
use crate::converter::Converter;
use crate::effects;
use crate::effects::chain::{Chain, Clock};
use crate::error::TestbedError;
use crate::integrator::Integrator;
use crate::noise::Noise;
use crate::plant::Truss;
use crate::state_space::multiply_add;
use crate::{INPUTS, OUTPUTS};

/// Largest output of a truss that counts as stable, V.
const UNBOUNDED_V: f64 = 1e6;

/// The outputs of a record, and the number of samples of each that the ADC clipped.
pub(crate) struct Recorded {
    pub outputs: Array2<f64>,
    pub clipped: Vec<usize>,
}

/// Returns the outputs (K x p) of the plant, as its linear effects changed it, for commands as the DAC gives them (K
/// x m). Without noise, the structure starts at rest and nothing is converted. With noise, it starts with the motion
/// that the ambient force has caused. The clocks of effects run on from the preceding records.
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
        noise.sensor(&mut outputs);
        let adc = Converter { step_v: config.converters.step_v, range_v: config.converters.range_v };
        (outputs, clipped) = convert(adc, outputs);
    }
    for effect in &mut chain.codes {
        effect.apply(clock, &mut outputs);
    }
    Ok(Recorded { outputs, clipped })
}

/// Returns the outputs at the samples, before the effects of the sensors. As many more rows follow as the sensor
/// effects look ahead, without a command.
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
        noise.start(&mut x[..states]);
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
            noise.amplifier(&mut u);
        }
        integrator.advance(&mut x, u, clock.time_s(k));
        if let Some(noise) = &mut noise {
            // Exact for the linear structure. An effect meets the motion due to the ambient force at the next sample.
            noise.ambient(&mut x[..states]);
        }
    }
    Ok(outputs)
}

/// Converts every channel, and counts the clipped samples of each.
pub(crate) fn convert(converter: Converter, mut signal: Array2<f64>) -> (Array2<f64>, Vec<usize>) {
    let mut clipped = vec![0; signal.ncols()];
    for ((_, channel), value) in signal.indexed_iter_mut() {
        let (coded, clips) = converter.convert(*value);
        *value = coded;
        clipped[channel] += usize::from(clips);
    }
    (signal, clipped)
}
