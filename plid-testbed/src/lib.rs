//! The simulated truss of Vallone and Hopkins (1995): structure, actuators, sensors and converters.
//!
//! It is the truth against which an identification is judged, so nothing in this crate depends on an identification.
//! A command passes through this chain:
//!
//! command -> DAC (held over a sample) -> amplifier noise -> actuator pole -> structure ->
//! accelerations -> anti-alias filter -> sampled at t_k, before u_k acts -> sensor noise -> ADC.
//!
//! [`effects`] contains further effects: at an actuator, in the structure, at a sensor, and from outside.
//!
//! [`truss`] gives the plant with its true model, modes and noise covariances; [`simulate`] runs the
//! experiment of a [`TrussConfig`]; [`simulate_input`] does so for an input given as an array.
//!
//! # Same seed, same bytes
//! Random numbers come from ChaCha12 with one stream per purpose and repeat, and the time stepping uses plain loops
//! without fused operations, so a run repeats bit by bit on one machine. Between machines, two things may differ in
//! the last bit: the mathematics library behind `sin`, `cos`, `exp` and `tan`, and the matrix products within the
//! matrix exponential, whose order depends on the processor's vector width. The difference is about 1e-15 V before a
//! converter with steps of 2.5 mV, so its codes almost always agree.

mod axes;
mod butterworth;
mod config;
mod converter;
mod covariance;
pub mod effects;
mod error;
pub mod gap;
mod input;
mod integrator;
mod noise;
mod plant;
mod record;
mod simulation;
mod state_space;
mod streams;
mod structure;

pub use butterworth::Butterworth;
pub use config::{
    Chirp, ConverterConfig, CubicJoint, EffectsConfig, InputConfig, Multisine, NoiseConfig, StructureConfig,
    TrussConfig, WhiteNoise,
};
pub use converter::Converter;
pub use effects::Effect;
pub use error::{TestbedError, Warning};
pub use plant::{NoiseCovariances, StrutPort, Truss, truss, truss_without_mode};
pub use simulation::{Simulation, simulate, simulate_input};
pub use state_space::StateSpace;
pub use structure::{Mode, ModeGroup};

/// Number of piezoelectric strut actuators, which are the inputs of the truss.
pub const INPUTS: usize = 3;
/// Number of accelerometers on the platform's corners, which are the outputs of the truss.
pub const OUTPUTS: usize = 3;
/// Pole of each actuator with its amplifier, in Hz.
pub const ACTUATOR_POLE_HZ: f64 = 260.0;
/// Corner of the two-pole Butterworth anti-alias filter, in Hz.
pub const ANTI_ALIAS_HZ: f64 = 1000.0;
