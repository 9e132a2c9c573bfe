//! Records that are difficult for a covariance. Each test below checks the property that gives the record its name.

use ndarray::{Array2, s};
use plid_testbed::{
    ConverterConfig, INPUTS, InputConfig, Multisine, NoiseConfig, Simulation, TestbedError, TrussConfig, WhiteNoise,
    simulate, simulate_input,
};

use super::record::{Record, lasting, of_simulation};

/// Relative difference between the second input and the first, and between the third and their sum.
pub const INDEPENDENT_PART: f64 = 1e-5;
/// Relative half-width of the band around the omitted mode that has no input.
pub const GAP: f64 = 0.1;
/// Frequency in Hz of the omitted mode, the first dominant one.
pub const MODE_HZ: f64 = 136.0;
/// Clipping level of the output converters in V, about the RMS of the outputs.
pub const CLIP_V: f64 = 0.45;
/// The share of a wind-up record, in its middle, that has no input.
pub const QUIET: f64 = 0.6;

/// The truss with sensor noise only, and without converters.
fn bare() -> TrussConfig {
    TrussConfig {
        noise: NoiseConfig { amplifier_rms_v: 0.0, ambient_rms_v: 0.0, ..NoiseConfig::default() },
        converters: ConverterConfig { step_v: 0.0, range_v: f64::INFINITY },
        ..TrussConfig::default()
    }
}

/// Returns the command described by a config.
fn command(config: &TrussConfig) -> Result<Array2<f64>, TestbedError> {
    Ok(simulate(config)?.commands)
}

/// Inputs with u2 close to u1 and u3 close to u1 + u2, so that the data contain almost no information on two
/// differences of the columns of B.
pub fn dependent_inputs(samples: usize) -> Result<Record, TestbedError> {
    let depend = |config: &TrussConfig| -> Result<Simulation, TestbedError> {
        let mut input = command(config)?;
        for mut row in input.rows_mut() {
            row[1] = row[0] + INDEPENDENT_PART * row[1];
            row[2] = row[0] + row[1] + INDEPENDENT_PART * row[2];
        }
        simulate_input(config, input.view())
    };
    let mut record = of_simulation(&depend(&lasting(bare(), samples))?, &bare())?;
    // The check tests only what the data determine.
    let check = depend(&lasting(TrussConfig { seed: bare().seed + 1, ..bare() }, record.check.inputs.nrows()))?;
    (record.check.inputs, record.check.outputs) = (check.commands, check.noise_free);
    record.actuator = amplifier_variance();
    Ok(record)
}

/// Sines in the band of the modes, with none near the omitted mode, and without a disturbance that could excite this
/// mode instead.
pub fn unexcited_mode(samples: usize) -> Result<Record, TestbedError> {
    let multisine = Multisine { band_hz: [20.0, MODE_HZ * (1.0 - GAP)], ..Multisine::default() };
    let upper = Multisine { band_hz: [MODE_HZ * (1.0 + GAP), 300.0], ..multisine.clone() };
    let of = |input: Multisine| lasting(TrussConfig { input: InputConfig::Multisine(input), ..bare() }, samples);
    let input = (command(&of(multisine))? + command(&of(upper))?) / std::f64::consts::SQRT_2;
    let mut record = of_simulation(&simulate_input(&lasting(bare(), samples), input.view())?, &bare())?;
    record.actuator = amplifier_variance();
    Ok(record)
}

/// Commands that the DAC clips for much of the time, and outputs that the ADC clips for about a third of it.
pub fn saturated_converters(samples: usize) -> Result<Record, TestbedError> {
    let loud = InputConfig::WhiteNoise(WhiteNoise { level_rms_v: [6.0; INPUTS], ..WhiteNoise::default() });
    let config = lasting(TrussConfig { input: loud, ..TrussConfig::default() }, samples);
    let mut record = of_simulation(&simulate(&config)?, &TrussConfig::default())?;
    let limit = super::record::single(CLIP_V);
    record.outputs.iter_mut().flatten().for_each(|z| *z = z.clamp(-limit, limit));
    Ok(record)
}

/// Excitation, followed by a long time without input and by further excitation.
pub fn wind_up(samples: usize) -> Result<Record, TestbedError> {
    let config = lasting(TrussConfig::default(), samples);
    let mut input = command(&config)?;
    let quiet = quiet(samples);
    input.slice_mut(s![quiet, ..]).fill(0.0);
    of_simulation(&simulate_input(&config, input.view())?, &TrussConfig::default())
}

/// Returns the range of samples without input.
pub fn quiet(samples: usize) -> std::ops::Range<usize> {
    let edge = (samples as f64 * (1.0 - QUIET) / 2.0) as usize;
    edge..samples - edge
}

/// Returns the variance of the amplifier noise that the recursion assumes. It is that of the default truss, although
/// there is no such noise.
fn amplifier_variance() -> f64 {
    NoiseConfig::default().amplifier_rms_v.powi(2)
}

/// Returns the power of a signal near a frequency relative to its mean power per line.
#[cfg(test)]
fn relative_power(signal: impl Iterator<Item = f64> + Clone, hz: f64, rate_hz: f64) -> f64 {
    let (mut re, mut im, mut power) = (0.0, 0.0, 0.0);
    let count = signal.clone().count();
    for (k, x) in signal.enumerate() {
        // A window prevents leakage from distant lines.
        let window = 1.0 - (std::f64::consts::TAU * (k as f64 + 0.5) / count as f64).cos();
        let angle = std::f64::consts::TAU * hz * k as f64 / rate_hz;
        re += window * x * angle.cos();
        im += window * x * angle.sin();
        power += x * x;
    }
    (re * re + im * im) / power
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dependent_inputs_are_nearly_dependent_and_not_quite() {
        let record = dependent_inputs(1000).unwrap();
        let rms =
            |f: &dyn Fn(&[f64; 3]) -> f64| (record.inputs.iter().map(|u| f(u).powi(2)).sum::<f64>() / 1000.0).sqrt();
        let size = rms(&|u| u[0]);
        for difference in [rms(&|u| u[1] - u[0]) / size, rms(&|u| u[2] - u[0] - u[1]) / size] {
            assert!((0.5e-5..2e-5).contains(&difference), "{difference}");
        }
    }

    #[test]
    fn one_mode_is_not_excited_and_its_neighbours_are() {
        let record = unexcited_mode(4096).unwrap();
        for channel in 0..3 {
            let at = |hz: f64| relative_power(record.inputs.iter().map(|u| u[channel]), hz, 1600.0);
            let around = [125.0, 129.0, 133.0, MODE_HZ, 139.0, 143.0, 147.0];
            assert!(around.iter().all(|&hz| at(hz) < 1e-5), "{:?}", around.map(at));
            // Lines are 1600 / 2048 Hz apart.
            let line = |hz: f64| (hz / (1600.0 / 2048.0)).round() * 1600.0 / 2048.0;
            assert!([100.0, 168.0, 186.0].iter().all(|&hz| at(line(hz)) > 1.0), "{}", at(line(168.0)));
        }
    }

    #[test]
    fn saturated_records_clip_on_both_sides() {
        let record = saturated_converters(2000).unwrap();
        let share = |values: Vec<f64>, limit: f64| {
            values.iter().filter(|x| x.abs() >= limit * 0.9999).count() as f64 / values.len() as f64
        };
        let commands = share(record.inputs.iter().flatten().copied().collect(), 5.0);
        let outputs = share(record.outputs.iter().flatten().copied().collect(), CLIP_V);
        assert!(commands > 0.2 && outputs > 0.3, "{commands} {outputs}");
    }

    #[test]
    fn wind_up_has_a_long_silence_between_two_excitations() {
        let record = wind_up(1000).unwrap();
        let quiet = quiet(1000);
        assert_eq!(quiet, 200..800);
        assert!(record.inputs[quiet].iter().flatten().all(|&u| u == 0.0));
        let loud = |range: &[[f64; 3]]| range.iter().flatten().filter(|&&u| u.abs() > 0.1).count() > range.len();
        assert!(loud(&record.inputs[..200]) && loud(&record.inputs[800..]));
    }
}
