//! Effects between the amplifier and the actuator's pole, and at the pole.

mod crosstalk;
mod dead_zone;
pub(crate) mod delay;
mod gain;
mod gain_drift;
mod hysteresis;
mod lag;
mod saturation;
mod slew_limit;

pub use crosstalk::ActuatorCrosstalk;
pub use dead_zone::ActuatorDeadZone;
pub use delay::ActuatorDelay;
pub use gain::ActuatorGain;
pub use gain_drift::ActuatorGainDrift;
pub use hysteresis::ActuatorHysteresis;
pub use lag::ActuatorLag;
pub use saturation::ActuatorSaturation;
pub use slew_limit::{ActuatorSlewLimit, SlewLaw};
