//! The records of the study, with the noise assumed in the identification.

use ndarray::Array2;
use plid_core::{NoiseModel, ObservableForm};
use plid_testbed::{INPUTS, OUTPUTS, Simulation, TestbedError, TrussConfig, simulate};

/// One record of 3 inputs and 3 outputs, with a noise-free record of the same plant for the check.
#[derive(Clone, Debug)]
pub struct Record {
    /// K samples of m inputs.
    pub inputs: Vec<[f64; INPUTS]>,
    /// K samples of p outputs.
    pub outputs: Vec<[f64; OUTPUTS]>,
    /// Variance of the noise of each sensor, as assumed by the recursion.
    pub sensor: f64,
    /// Variance of the noise of each actuator, as assumed by the recursion.
    pub actuator: f64,
    /// The parameters [a_1; ..; a_p; b_1; ..; b_m] at the end of the record, if the plant is of the model's class.
    pub truth: Option<Vec<f64>>,
    /// An input that the identification does not use, and the response of the plant to it from rest without any
    /// noise.
    pub check: Check,
}

/// The inputs and outputs of a check, as samples x channels.
#[derive(Clone, Debug)]
pub struct Check {
    /// K x m.
    pub inputs: Array2<f64>,
    /// K x p.
    pub outputs: Array2<f64>,
    /// Sample rate in Hz.
    pub rate_hz: f64,
    /// The band of the inputs in Hz.
    pub band_hz: [f64; 2],
}

/// The assumed Sigma of every state, which represents ambient forces and truncated modes.
pub const STATE_NOISE: f64 = 1e-6;
/// Number of samples of the check.
const CHECK_SAMPLES: usize = 4096;
/// The band in Hz in which the default command of the truss has its power (-3 dB at 200 Hz) and the five dominant
/// modes lie.
pub const TRUSS_BAND_HZ: [f64; 2] = [2.0, 250.0];

/// Rounds to single precision. All scalars receive identical data, noise and start, so that only the arithmetic
/// differs.
pub fn single(x: f64) -> f64 {
    f64::from(x as f32)
}

impl Record {
    /// Returns the noise model of an identification with the states of `form`.
    pub fn noise(&self, form: &ObservableForm) -> NoiseModel {
        let states = form.indices().iter().sum();
        NoiseModel::diagonal(
            &[single(self.sensor); OUTPUTS],
            &[single(self.actuator); INPUTS],
            &vec![single(STATE_NOISE); states],
        )
    }

    /// Returns the record with all samples rounded to single precision.
    pub(super) fn rounded(mut self) -> Self {
        let all = self.inputs.iter_mut().flatten().chain(self.outputs.iter_mut().flatten());
        all.for_each(|x| *x = single(*x));
        self
    }
}

/// Returns a record of the default truss with sensor noise of `sensor_rms_v` and `samples` samples, in which no
/// sample repeats.
pub fn truss(samples: usize, sensor_rms_v: f64) -> Result<Record, TestbedError> {
    let mut config = lasting(TrussConfig::default(), samples);
    config.noise.sensor_rms_v = sensor_rms_v;
    of_simulation(&simulate(&config)?, &TrussConfig::default())
}

/// Returns the config with a duration of this many samples.
pub(super) fn lasting(config: TrussConfig, samples: usize) -> TrussConfig {
    TrussConfig { duration_s: samples as f64 / config.sample_rate_hz, ..config }
}

/// Returns the record of a simulation. The check is a run of `plant` with another seed.
pub(super) fn of_simulation(simulation: &Simulation, plant: &TrussConfig) -> Result<Record, TestbedError> {
    let check = simulate(&lasting(TrussConfig { seed: plant.seed + 1, ..plant.clone() }, CHECK_SAMPLES))?;
    let truth = &simulation.truth;
    let rows = |array: &Array2<f64>| array.rows().into_iter().map(|row| std::array::from_fn(|i| row[i])).collect();
    let record = Record {
        inputs: rows(&simulation.commands),
        outputs: rows(&simulation.outputs[0]),
        sensor: truth.noise.sensor[(0, 0)],
        actuator: truth.noise.actuator[(0, 0)],
        truth: None,
        check: Check {
            inputs: check.commands,
            outputs: check.noise_free,
            rate_hz: simulation.sample_rate_hz,
            band_hz: TRUSS_BAND_HZ,
        },
    };
    Ok(record.rounded())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_is_as_long_as_asked_for_and_holds_single_precision_numbers() {
        let record = truss(500, 0.005).unwrap();
        assert_eq!((record.inputs.len(), record.outputs.len()), (500, 500));
        assert!(record.outputs.iter().flatten().all(|&x| x == f64::from(x as f32)));
        // No sample repeats, so the record is not a loop.
        assert!((1..500).all(|k| record.inputs[k] != record.inputs[0]));
        let form = ObservableForm::balanced(6, OUTPUTS, INPUTS).unwrap();
        assert!(record.noise(&form).check(OUTPUTS, INPUTS, 6).is_ok());
        assert_eq!(record.check.inputs.dim(), (CHECK_SAMPLES, INPUTS));
    }
}
