//! The configuration of an experiment, as a user writes it.

use serde::{Deserialize, Serialize};

use crate::effects::law::Limits;
use crate::effects::{self, Effect};
use crate::error::TestbedError;
use crate::{INPUTS, structure};

/// Largest number of samples over all repeats.
const MOST_SAMPLES: usize = 50_000_000;
/// The range of rates in which the exact discretisation is tested, Hz.
const RATES_HZ: [f64; 2] = [1.0, 1e6];

/// An experiment on the simulated truss. The default is the paper's: 13 s at 1600 Hz, all three inputs with
/// 1 V RMS of white noise below 200 Hz.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrussConfig {
    /// Rate of both converters, Hz; from 1 to 1e6.
    pub sample_rate_hz: f64,
    /// Length of a record, s; rounded to whole samples.
    pub duration_s: f64,
    /// Number of records of the same input, each with new noise. They follow one another without pauses, and each
    /// starts from rest.
    pub repeats: usize,
    /// Seed of all random numbers.
    pub seed: u64,
    /// The command.
    pub input: InputConfig,
    /// Noise levels.
    pub noise: NoiseConfig,
    /// DAC and ADC.
    pub converters: ConverterConfig,
    /// Options of the structure.
    pub structure: StructureConfig,
    /// Optional effects that a linear time-invariant model lacks.
    pub effects: EffectsConfig,
}

impl Default for TrussConfig {
    fn default() -> Self {
        Self {
            sample_rate_hz: 1600.0,
            duration_s: 13.0,
            repeats: 1,
            seed: 1,
            input: InputConfig::default(),
            noise: NoiseConfig::default(),
            converters: ConverterConfig::default(),
            structure: StructureConfig::default(),
            effects: EffectsConfig::default(),
        }
    }
}

/// The command before the DAC. In TOML it is either `input = "zero"` or a table such as `[input.white-noise]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum InputConfig {
    /// No command: the truss at rest.
    Zero,
    /// Gaussian white noise through a low-pass filter.
    WhiteNoise(WhiteNoise),
    /// A periodic sum of sines with random phases.
    Multisine(Multisine),
    /// A sine whose frequency changes linearly over the record.
    Chirp(Chirp),
}

impl Default for InputConfig {
    fn default() -> Self {
        InputConfig::WhiteNoise(WhiteNoise::default())
    }
}

/// Gaussian white noise through a sixth-order Butterworth low-pass filter, independent between inputs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WhiteNoise {
    /// RMS of the record of each input, V.
    pub level_rms_v: [f64; INPUTS],
    /// Cut-off frequency (-3 dB), Hz.
    pub cutoff_hz: f64,
}

impl Default for WhiteNoise {
    fn default() -> Self {
        Self { level_rms_v: [1.0; INPUTS], cutoff_hz: 200.0 }
    }
}

/// Sines of equal amplitude at all multiples of the base frequency in a band, with random phases, independent between
/// inputs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Multisine {
    /// RMS of a period of each input, V.
    pub level_rms_v: [f64; INPUTS],
    /// Number of samples in a period.
    pub period_samples: usize,
    /// Lowest and highest frequency, Hz.
    pub band_hz: [f64; 2],
}

impl Default for Multisine {
    fn default() -> Self {
        Self { level_rms_v: [1.0; INPUTS], period_samples: 2048, band_hz: [20.0, 300.0] }
    }
}

/// A sine whose frequency changes linearly over the record; the same on every input apart from the level.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Chirp {
    /// RMS of the record of each input, V. By default, only the first input is driven.
    pub level_rms_v: [f64; INPUTS],
    /// Frequency at the start, Hz.
    pub start_hz: f64,
    /// Frequency at the end, Hz.
    pub end_hz: f64,
}

impl Default for Chirp {
    fn default() -> Self {
        Self { level_rms_v: [1.0, 0.0, 0.0], start_hz: 20.0, end_hz: 300.0 }
    }
}

/// Noise levels. Each may be zero, which leaves the noise of the other sources unchanged.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct NoiseConfig {
    /// Noise on each sampled output, V RMS; white and Gaussian apart from the two shares below.
    pub sensor_rms_v: f64,
    /// White noise on each held command, V RMS.
    pub amplifier_rms_v: f64,
    /// The response to the ambient force alone after the anti-alias filter, V RMS over the three outputs together.
    /// With the default levels of the other two sources, the outputs at rest are then at 15-20 mV.
    pub ambient_rms_v: f64,
    /// Share of the variance of the sensor noise that has passed through a pole at `coloured_hz`.
    pub coloured_share: f64,
    /// The pole of the coloured part, Hz.
    pub coloured_hz: f64,
    /// Share of the variance of the sensor noise that follows Student's t with three degrees of freedom.
    pub heavy_share: f64,
}

impl NoiseConfig {
    /// No noise at all.
    pub const NONE: Self = Self {
        sensor_rms_v: 0.0,
        amplifier_rms_v: 0.0,
        ambient_rms_v: 0.0,
        coloured_share: 0.0,
        coloured_hz: 20.0,
        heavy_share: 0.0,
    };
}

impl Default for NoiseConfig {
    fn default() -> Self {
        Self { sensor_rms_v: 0.005, amplifier_rms_v: 0.005, ambient_rms_v: 0.016, ..Self::NONE }
    }
}

/// The synchronised converters, the same for DAC and ADC.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ConverterConfig {
    /// Size of a code, V; 0 leaves values unrounded.
    pub step_v: f64,
    /// Values are clipped at plus and minus this, V; `inf` leaves them unclipped.
    pub range_v: f64,
}

impl Default for ConverterConfig {
    fn default() -> Self {
        Self { step_v: 0.0025, range_v: 5.0 }
    }
}

/// Options of the structure.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct StructureConfig {
    /// Bending modes of each of the six strut tubes: 2 (24 states), or 1 for the paper's count of 12 states.
    pub strut_modes_per_tube: usize,
}

impl Default for StructureConfig {
    fn default() -> Self {
        Self { strut_modes_per_tube: 2 }
    }
}

/// Effects that a linear time-invariant model lacks. None by default.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EffectsConfig {
    /// r in `w_m^2 -> w_m^2 (1 + r t)` for every mode, 1/s; t runs on through the repeats.
    pub stiffness_drift_per_s: f64,
    /// Cubic stiffness at one strut.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cubic_joint: Option<CubicJoint>,
    /// Integration steps within a sample, used only where an effect acts inside the structure or changes a voltage
    /// within a sample.
    pub steps_per_sample: usize,
    /// Any number of simultaneous effects.
    pub list: Vec<Effect>,
}

impl Default for EffectsConfig {
    fn default() -> Self {
        Self { stiffness_drift_per_s: 0.0, cubic_joint: None, steps_per_sample: 4, list: Vec::new() }
    }
}

/// Cubic stiffness at the strut of an input: f = -k d^3. A displacement d of 1 V is the displacement under a constant
/// command of 1 V, and a force f of 1 V is the force of a command of 1 V.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CubicJoint {
    /// The input at whose strut the joint is, from 1.
    pub input: usize,
    /// k, 1/V^2; positive hardens, negative softens.
    pub stiffness_per_v2: f64,
}

impl TrussConfig {
    /// Returns the number of samples of a record.
    ///
    /// # Errors
    /// Returns an error if the rate is not from 1 Hz to 1 MHz, if the duration is not positive, or if the record has
    /// no sample or too many.
    pub fn samples(&self) -> Result<usize, TestbedError> {
        let (value, [least, most]) = (self.sample_rate_hz, RATES_HZ);
        positive("sample_rate_hz", value)?;
        if !(least..=most).contains(&value) {
            return Err(TestbedError::Rate { value, least, most });
        }
        positive("duration_s", self.duration_s)?;
        let samples = (self.duration_s * self.sample_rate_hz).round();
        let total = samples * self.repeats as f64;
        if samples < 1.0 || total > MOST_SAMPLES as f64 {
            return Err(TestbedError::RecordLength {
                duration_s: self.duration_s,
                sample_rate_hz: self.sample_rate_hz,
                samples: total,
                most: MOST_SAMPLES,
            });
        }
        Ok(samples as usize)
    }

    /// Checks every key except those of the input's signal, which [`simulate`](crate::simulate) checks.
    ///
    /// # Errors
    /// Returns an error that names the first key that is wrong.
    pub fn check(&self) -> Result<(), TestbedError> {
        within("repeats", self.repeats, 1, MOST_SAMPLES)?;
        let modes = self.structure.strut_modes_per_tube * structure::TUBES + structure::PLATFORM_MODES;
        self.check_for(modes, self.samples()? * self.repeats)
    }

    /// Checks the keys for a plant with `modes` modes and for a record that ends `end` samples after the first one
    /// began. The keys on the number of samples are not considered: a gap case has a schedule of its own.
    pub(crate) fn check_for(&self, modes: usize, end: usize) -> Result<(), TestbedError> {
        not_negative("noise.sensor_rms_v", self.noise.sensor_rms_v)?;
        not_negative("noise.amplifier_rms_v", self.noise.amplifier_rms_v)?;
        not_negative("noise.ambient_rms_v", self.noise.ambient_rms_v)?;
        not_negative("noise.coloured_share", self.noise.coloured_share)?;
        positive("noise.coloured_hz", self.noise.coloured_hz)?;
        not_negative("noise.heavy_share", self.noise.heavy_share)?;
        let white = 1.0 - self.noise.coloured_share - self.noise.heavy_share;
        not_negative("1 - noise.coloured_share - noise.heavy_share", white)?;
        not_negative("converters.step_v", self.converters.step_v)?;
        if self.converters.range_v != f64::INFINITY {
            positive("converters.range_v", self.converters.range_v)?;
        }
        within(
            "structure.strut_modes_per_tube",
            self.structure.strut_modes_per_tube,
            1,
            structure::MOST_MODES_PER_TUBE,
        )?;
        within("effects.steps_per_sample", self.effects.steps_per_sample, 1, 1000)?;
        let rate = self.effects.stiffness_drift_per_s;
        finite("effects.stiffness_drift_per_s", rate)?;
        let end_s = end as f64 / self.sample_rate_hz;
        if 1.0 + rate * end_s <= 0.0 {
            return Err(TestbedError::NoStiffness { rate, end_s });
        }
        if let Some(joint) = &self.effects.cubic_joint {
            within("effects.cubic_joint.input", joint.input, 1, INPUTS)?;
            finite("effects.cubic_joint.stiffness_per_v2", joint.stiffness_per_v2)?;
        }
        effects::check(&self.effects, &Limits { sample_rate_hz: self.sample_rate_hz, end_s, modes })
    }
}

pub(crate) fn positive(key: &'static str, value: f64) -> Result<(), TestbedError> {
    if value > 0.0 && value.is_finite() { Ok(()) } else { Err(TestbedError::NotPositive { key, value }) }
}

pub(crate) fn not_negative(key: &'static str, value: f64) -> Result<(), TestbedError> {
    if value >= 0.0 && value.is_finite() { Ok(()) } else { Err(TestbedError::Negative { key, value }) }
}

pub(crate) fn finite(key: &'static str, value: f64) -> Result<(), TestbedError> {
    if value.is_finite() { Ok(()) } else { Err(TestbedError::NotFinite { key, value }) }
}

pub(crate) fn within(key: &'static str, value: usize, least: usize, most: usize) -> Result<(), TestbedError> {
    if (least..=most).contains(&value) { Ok(()) } else { Err(TestbedError::OutOfRange { key, value, least, most }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A gap case has records of its own, whose length has nothing to do with the duration of the config.
    #[test]
    fn a_drift_is_checked_up_to_the_end_of_the_record() {
        let mut config = TrussConfig::default();
        // Nothing is left of the stiffness after 10 s.
        config.effects.stiffness_drift_per_s = -0.1;
        let end = |seconds: f64| (seconds * config.sample_rate_hz) as usize;
        assert_eq!(config.check_for(10, end(9.9)), Ok(()));
        assert_eq!(config.check_for(10, end(10.1)), Err(TestbedError::NoStiffness { rate: -0.1, end_s: 10.1 }));
    }
}
