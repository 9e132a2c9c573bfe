//! Effects outside the vocabulary of the diagnosis. Their names begin with `x-`.

mod channel_product;
mod clock_skew;
mod command_play;
mod delay_jitter;
mod force_factor;
mod foreshortening;
mod intermittent_contact;
mod parametric_stiffness;
mod proportional_noise;
mod resonant_crosstalk;
mod sensor_rate_limit;
mod sensor_square;
mod sticking_valve;
mod supply_sag;
mod thermal_gain;
mod varying_damping;

pub use channel_product::ChannelProduct;
pub use clock_skew::ClockSkew;
pub use command_play::CommandPlay;
pub use delay_jitter::DelayJitter;
pub use force_factor::ForceFactor;
pub use foreshortening::Foreshortening;
pub use intermittent_contact::IntermittentContact;
pub use parametric_stiffness::ParametricStiffness;
pub use proportional_noise::ProportionalNoise;
pub use resonant_crosstalk::ResonantCrosstalk;
pub use sensor_rate_limit::SensorRateLimit;
pub use sensor_square::SensorSquare;
pub use sticking_valve::StickingValve;
pub use supply_sag::SupplySag;
pub use thermal_gain::ThermalGain;
pub use varying_damping::VaryingDamping;
