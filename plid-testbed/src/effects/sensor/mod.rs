//! Effects on the samples: before the sensor noise, and after the ADC.

mod crosstalk;
mod delay;
mod drift;
mod dropout;
mod gain;
mod hum;
mod lag;
mod noise;
mod offset;
mod quantisation;
mod saturation;

pub(crate) use delay::{LOOK_AHEAD, band_limited};

pub use crosstalk::SensorCrosstalk;
pub use delay::{SensorDelay, SensorDelayLaw};
pub use drift::SensorDrift;
pub use dropout::{DropoutLaw, SensorDropout};
pub use gain::SensorGain;
pub use hum::{Harmonic, MainsHum};
pub use lag::{SensorLag, SensorLagLaw};
pub use noise::{NoiseLaw, SensorNoise};
pub use offset::SensorOffset;
pub use quantisation::{QuantisationLaw, SensorQuantisation};
pub use saturation::SensorSaturation;
