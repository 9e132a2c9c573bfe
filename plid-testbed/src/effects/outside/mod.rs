//! Effects for which a diagnosis has no word. Their names begin with x.

mod channel_product;
mod command_play;
mod delay_jitter;
mod parametric_stiffness;
mod sensor_rate_limit;
mod sensor_square;
mod sticking_valve;
mod varying_damping;

pub use channel_product::ChannelProduct;
pub use command_play::CommandPlay;
pub use delay_jitter::DelayJitter;
pub use parametric_stiffness::ParametricStiffness;
pub use sensor_rate_limit::SensorRateLimit;
pub use sensor_square::SensorSquare;
pub use sticking_valve::StickingValve;
pub use varying_damping::VaryingDamping;
