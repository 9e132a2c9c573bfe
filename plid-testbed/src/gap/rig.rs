//! The surroundings of a plant: the rate, the commands, the sensors and their converters.

use rand::RngExt;
use rand_chacha::ChaCha12Rng;

use crate::config::{ConverterConfig, NoiseConfig};

/// The rig of a case.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Rig {
    /// Rate of commands and samples, Hz.
    pub sample_rate_hz: f64,
    /// Cut-off of random commands, Hz.
    pub band_hz: f64,
    /// Lowest and highest line of the multisine, as multiples of the sample rate over the period of full records.
    pub lines: [usize; 2],
    /// RMS over the outputs that a random record of 1 V RMS must give, V; `None` leaves the plant as it is.
    pub output_v: Option<f64>,
    /// Noise of the plant.
    pub noise: NoiseConfig,
    /// Converter of the sensors.
    pub adc: ConverterConfig,
    /// Standard deviation of the noise that the simulation declares for each output, V.
    pub declared_sensor_v: f64,
    /// Integration steps within a sample.
    pub steps_per_sample: usize,
}

/// Number of samples in a period of the multisine in full records: a prime, so that no mains frequency falls on one
/// of its lines.
pub(crate) const PERIOD: usize = 2003;
/// Rate of the cases of structures, Hz.
pub(crate) const STRUCTURE_HZ: f64 = 1600.0;
/// Standard deviation of sensor noise and of amplifier noise of structures, V.
pub(crate) const NOISE_V: f64 = 0.005;

/// RMS over the outputs that a random record of 1 V RMS gives, V.
const OUTPUT_V: f64 = 0.45;
/// Rates at which axes are sampled, Hz.
const AXIS_HZ: [f64; 5] = [200.0, 250.0, 400.0, 500.0, 1000.0];
/// Share of plants with axes whose sensors are encoders; the others have white noise and a fine converter.
const ENCODERS: f64 = 0.5;
/// Size of an encoder's code, V.
const CODE_V: std::ops::Range<f64> = 0.004..0.016;
/// White noise before the rounding of an encoder, over its step: the trembling of an axis.
const TREMBLES: f64 = 0.3;
/// Integration steps within a sample. Friction that sticks needs more of them than other forces do.
const AXIS_STEPS: usize = 32;
/// Highest line of the multisine over the cut-off of random commands.
const BEYOND_BAND: f64 = 1.5;

impl Rig {
    /// Returns the rig of a structure: accelerometers and 12-bit converters of +-5 V. The lines go from 2.4 to 395
    /// Hz.
    pub(crate) fn of_structure() -> Self {
        Self {
            sample_rate_hz: STRUCTURE_HZ,
            band_hz: 200.0,
            lines: [3, 495],
            output_v: Some(OUTPUT_V),
            noise: NoiseConfig {
                sensor_rms_v: NOISE_V,
                amplifier_rms_v: NOISE_V,
                ambient_rms_v: 0.002,
                ..NoiseConfig::NONE
            },
            adc: ConverterConfig { step_v: 10.0 / 4096.0, range_v: 5.0 },
            declared_sensor_v: NOISE_V,
            steps_per_sample: super::STEPS_PER_SAMPLE,
        }
    }

    /// Draws the rig of axes whose random commands reach up to a share of the sample rate. Commands are numbers that
    /// a drive reads, so they have no noise. Encoders count without limit.
    pub(crate) fn of_axes(sample_rate_hz: f64, band: f64, rng: &mut ChaCha12Rng) -> Self {
        let encoder = rng.random_bool(ENCODERS);
        let code_v = rng.random_range(CODE_V);
        let (sensor_rms_v, step_v) = if encoder { (TREMBLES * code_v, code_v) } else { (NOISE_V, 10.0 / 65536.0) };
        Self {
            sample_rate_hz,
            band_hz: band * sample_rate_hz,
            lines: [1, (BEYOND_BAND * band * PERIOD as f64) as usize],
            output_v: Some(OUTPUT_V),
            noise: NoiseConfig { sensor_rms_v, ..NoiseConfig::NONE },
            adc: ConverterConfig { step_v, range_v: f64::INFINITY },
            declared_sensor_v: sensor_rms_v.hypot(step_v / 12.0_f64.sqrt()),
            steps_per_sample: AXIS_STEPS,
        }
    }
}

/// Draws the rate of axes, Hz.
pub(crate) fn axis_rate_hz(rng: &mut ChaCha12Rng) -> f64 {
    AXIS_HZ[rng.random_range(0..AXIS_HZ.len())]
}
