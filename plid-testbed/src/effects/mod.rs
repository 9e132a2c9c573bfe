//! Effects: what the nominal linear time-invariant model lacks. One file an effect.
//!
//! An effect is a `Law`: it changes the linear plant, or takes its place in the chain of a record: between
//! amplifier and actuator pole, inside the structure (integrated in continuous time together with it), on the samples before
//! the sensor noise, or behind the ADC. Effects at one place act in the order of the list. All internal states are zero at the
//! start of a record; clocks and phases run on.

pub mod actuator;
pub(crate) mod chain;
pub mod disturbance;
pub(crate) mod law;
#[cfg(test)]
mod oscillator;
pub mod outside;
pub mod place;
pub mod sensor;
pub mod shapes;
pub mod structure;

use serde::{Deserialize, Serialize};

use self::chain::{Chain, Clock, Site};
use self::law::{Law, Limits, Plant};
use self::place::Input;
use crate::config::EffectsConfig;
use crate::error::TestbedError;
use crate::plant::Truss;
use crate::streams::{Purpose, stream};

/// An effect of the list. In TOML a table with its `kind`, its place `at` and its parameters; many take another `law` of the
/// same physics than the vocabulary's own.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
#[allow(missing_docs)] // Each is documented where it is defined.
pub enum Effect {
    CubicStiffness(structure::CubicStiffness),
    QuadraticStiffness(structure::QuadraticStiffness),
    CoulombFriction(structure::CoulombFriction),
    Clearance(structure::Clearance),
    JointHysteresis(structure::JointHysteresis),
    QuadraticDamping(structure::QuadraticDamping),
    ModalFrequency(structure::ModalFrequency),
    ModalDamping(structure::ModalDamping),
    MissingMode(structure::MissingMode),
    StiffnessDrift(structure::StiffnessDrift),
    ActuatorSaturation(actuator::ActuatorSaturation),
    ActuatorDeadZone(actuator::ActuatorDeadZone),
    ActuatorHysteresis(actuator::ActuatorHysteresis),
    ActuatorSlewLimit(actuator::ActuatorSlewLimit),
    ActuatorLag(actuator::ActuatorLag),
    ActuatorGain(actuator::ActuatorGain),
    ActuatorDelay(actuator::ActuatorDelay),
    ActuatorCrosstalk(actuator::ActuatorCrosstalk),
    ActuatorGainDrift(actuator::ActuatorGainDrift),
    SensorSaturation(sensor::SensorSaturation),
    SensorGain(sensor::SensorGain),
    SensorDelay(sensor::SensorDelay),
    SensorLag(sensor::SensorLag),
    SensorCrosstalk(sensor::SensorCrosstalk),
    SensorOffset(sensor::SensorOffset),
    SensorDrift(sensor::SensorDrift),
    MainsHum(sensor::MainsHum),
    SensorNoise(sensor::SensorNoise),
    SensorQuantisation(sensor::SensorQuantisation),
    SensorDropout(sensor::SensorDropout),
    NarrowbandDisturbance(disturbance::NarrowbandDisturbance),
    ColouredDisturbance(disturbance::ColouredDisturbance),
    #[serde(rename = "x-channel-product")]
    ChannelProduct(outside::ChannelProduct),
    #[serde(rename = "x-command-play")]
    CommandPlay(outside::CommandPlay),
    #[serde(rename = "x-delay-jitter")]
    DelayJitter(outside::DelayJitter),
    #[serde(rename = "x-parametric-stiffness")]
    ParametricStiffness(outside::ParametricStiffness),
    #[serde(rename = "x-sensor-rate-limit")]
    SensorRateLimit(outside::SensorRateLimit),
    #[serde(rename = "x-sensor-square")]
    SensorSquare(outside::SensorSquare),
    #[serde(rename = "x-sticking-valve")]
    StickingValve(outside::StickingValve),
    #[serde(rename = "x-varying-damping")]
    VaryingDamping(outside::VaryingDamping),
}

impl Effect {
    pub(crate) fn law(&self) -> &dyn Law {
        match self {
            Effect::CubicStiffness(effect) => effect,
            Effect::QuadraticStiffness(effect) => effect,
            Effect::CoulombFriction(effect) => effect,
            Effect::Clearance(effect) => effect,
            Effect::JointHysteresis(effect) => effect,
            Effect::QuadraticDamping(effect) => effect,
            Effect::ModalFrequency(effect) => effect,
            Effect::ModalDamping(effect) => effect,
            Effect::MissingMode(effect) => effect,
            Effect::StiffnessDrift(effect) => effect,
            Effect::ActuatorSaturation(effect) => effect,
            Effect::ActuatorDeadZone(effect) => effect,
            Effect::ActuatorHysteresis(effect) => effect,
            Effect::ActuatorSlewLimit(effect) => effect,
            Effect::ActuatorLag(effect) => effect,
            Effect::ActuatorGain(effect) => effect,
            Effect::ActuatorDelay(effect) => effect,
            Effect::ActuatorCrosstalk(effect) => effect,
            Effect::ActuatorGainDrift(effect) => effect,
            Effect::SensorSaturation(effect) => effect,
            Effect::SensorGain(effect) => effect,
            Effect::SensorDelay(effect) => effect,
            Effect::SensorLag(effect) => effect,
            Effect::SensorCrosstalk(effect) => effect,
            Effect::SensorOffset(effect) => effect,
            Effect::SensorDrift(effect) => effect,
            Effect::MainsHum(effect) => effect,
            Effect::SensorNoise(effect) => effect,
            Effect::SensorQuantisation(effect) => effect,
            Effect::SensorDropout(effect) => effect,
            Effect::NarrowbandDisturbance(effect) => effect,
            Effect::ColouredDisturbance(effect) => effect,
            Effect::ChannelProduct(effect) => effect,
            Effect::CommandPlay(effect) => effect,
            Effect::DelayJitter(effect) => effect,
            Effect::ParametricStiffness(effect) => effect,
            Effect::SensorRateLimit(effect) => effect,
            Effect::SensorSquare(effect) => effect,
            Effect::StickingValve(effect) => effect,
            Effect::VaryingDamping(effect) => effect,
        }
    }

    fn law_mut(&mut self) -> &mut dyn Law {
        match self {
            Effect::CubicStiffness(effect) => effect,
            Effect::QuadraticStiffness(effect) => effect,
            Effect::CoulombFriction(effect) => effect,
            Effect::Clearance(effect) => effect,
            Effect::JointHysteresis(effect) => effect,
            Effect::QuadraticDamping(effect) => effect,
            Effect::ModalFrequency(effect) => effect,
            Effect::ModalDamping(effect) => effect,
            Effect::MissingMode(effect) => effect,
            Effect::StiffnessDrift(effect) => effect,
            Effect::ActuatorSaturation(effect) => effect,
            Effect::ActuatorDeadZone(effect) => effect,
            Effect::ActuatorHysteresis(effect) => effect,
            Effect::ActuatorSlewLimit(effect) => effect,
            Effect::ActuatorLag(effect) => effect,
            Effect::ActuatorGain(effect) => effect,
            Effect::ActuatorDelay(effect) => effect,
            Effect::ActuatorCrosstalk(effect) => effect,
            Effect::ActuatorGainDrift(effect) => effect,
            Effect::SensorSaturation(effect) => effect,
            Effect::SensorGain(effect) => effect,
            Effect::SensorDelay(effect) => effect,
            Effect::SensorLag(effect) => effect,
            Effect::SensorCrosstalk(effect) => effect,
            Effect::SensorOffset(effect) => effect,
            Effect::SensorDrift(effect) => effect,
            Effect::MainsHum(effect) => effect,
            Effect::SensorNoise(effect) => effect,
            Effect::SensorQuantisation(effect) => effect,
            Effect::SensorDropout(effect) => effect,
            Effect::NarrowbandDisturbance(effect) => effect,
            Effect::ColouredDisturbance(effect) => effect,
            Effect::ChannelProduct(effect) => effect,
            Effect::CommandPlay(effect) => effect,
            Effect::DelayJitter(effect) => effect,
            Effect::ParametricStiffness(effect) => effect,
            Effect::SensorRateLimit(effect) => effect,
            Effect::SensorSquare(effect) => effect,
            Effect::StickingValve(effect) => effect,
            Effect::VaryingDamping(effect) => effect,
        }
    }

    /// Its name in the vocabulary; outsiders' begin with `x-`.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        match self {
            Effect::CubicStiffness(_) => "cubic-stiffness",
            Effect::QuadraticStiffness(_) => "quadratic-stiffness",
            Effect::CoulombFriction(_) => "coulomb-friction",
            Effect::Clearance(_) => "clearance",
            Effect::JointHysteresis(_) => "joint-hysteresis",
            Effect::QuadraticDamping(_) => "quadratic-damping",
            Effect::ModalFrequency(_) => "modal-frequency",
            Effect::ModalDamping(_) => "modal-damping",
            Effect::MissingMode(_) => "missing-mode",
            Effect::StiffnessDrift(_) => "stiffness-drift",
            Effect::ActuatorSaturation(_) => "actuator-saturation",
            Effect::ActuatorDeadZone(_) => "actuator-dead-zone",
            Effect::ActuatorHysteresis(_) => "actuator-hysteresis",
            Effect::ActuatorSlewLimit(_) => "actuator-slew-limit",
            Effect::ActuatorLag(_) => "actuator-lag",
            Effect::ActuatorGain(_) => "actuator-gain",
            Effect::ActuatorDelay(_) => "actuator-delay",
            Effect::ActuatorCrosstalk(_) => "actuator-crosstalk",
            Effect::ActuatorGainDrift(_) => "actuator-gain-drift",
            Effect::SensorSaturation(_) => "sensor-saturation",
            Effect::SensorGain(_) => "sensor-gain",
            Effect::SensorDelay(_) => "sensor-delay",
            Effect::SensorLag(_) => "sensor-lag",
            Effect::SensorCrosstalk(_) => "sensor-crosstalk",
            Effect::SensorOffset(_) => "sensor-offset",
            Effect::SensorDrift(_) => "sensor-drift",
            Effect::MainsHum(_) => "mains-hum",
            Effect::SensorNoise(_) => "sensor-noise",
            Effect::SensorQuantisation(_) => "sensor-quantisation",
            Effect::SensorDropout(_) => "sensor-dropout",
            Effect::NarrowbandDisturbance(_) => "narrowband-disturbance",
            Effect::ColouredDisturbance(_) => "coloured-disturbance",
            Effect::ChannelProduct(_) => "x-channel-product",
            Effect::CommandPlay(_) => "x-command-play",
            Effect::DelayJitter(_) => "x-delay-jitter",
            Effect::ParametricStiffness(_) => "x-parametric-stiffness",
            Effect::SensorRateLimit(_) => "x-sensor-rate-limit",
            Effect::SensorSquare(_) => "x-sensor-square",
            Effect::StickingValve(_) => "x-sticking-valve",
            Effect::VaryingDamping(_) => "x-varying-damping",
        }
    }

    /// One that changes nothing.
    pub(crate) fn idle() -> Self {
        Effect::ActuatorGain(actuator::ActuatorGain { at: Input(0), gain: 1.0 })
    }

    /// Makes it stronger by a factor: what it changes grows with it, to first order in proportion where the law allows that.
    #[must_use]
    pub fn strengthened(&self, factor: f64) -> Self {
        let mut stronger = self.clone();
        stronger.law_mut().strengthen(factor);
        stronger
    }

    /// The place for a label, from 0: an input, output or mode; the number of inputs stands for all of them.
    #[must_use]
    pub fn place(&self) -> usize {
        self.law().place()
    }

    /// The parameters for a label, in the order of the vocabulary.
    #[must_use]
    pub fn parameters(&self) -> Vec<f64> {
        self.law().parameters()
    }

    /// Whether its law is the vocabulary's own equation, not a near miss in shape.
    #[must_use]
    pub fn own_equation(&self) -> bool {
        self.law().own_equation()
    }

    /// Whether somebody who knows its parameters could foretell what it does in a record.
    #[must_use]
    pub fn foretold(&self) -> bool {
        self.law().foretold()
    }
}

/// The effects of a config in one list: first the two that have keys of their own.
fn list(config: &EffectsConfig) -> Vec<Effect> {
    let mut effects = Vec::new();
    if config.stiffness_drift_per_s != 0.0 {
        let rate_per_s = config.stiffness_drift_per_s;
        effects.push(Effect::StiffnessDrift(structure::StiffnessDrift { rate_per_s, law: shapes::Course::Linear }));
    }
    if let Some(joint) = &config.cubic_joint {
        effects.push(Effect::CubicStiffness(structure::CubicStiffness {
            at: Input(joint.input - 1),
            stiffness_per_v2: joint.stiffness_per_v2,
            law: structure::CubicLaw::Cubic,
            scale_v: 1.0,
        }));
    }
    effects.extend(config.list.iter().cloned());
    effects
}

/// Checks the effects of the list.
pub(crate) fn check(config: &EffectsConfig, limits: &Limits) -> Result<(), TestbedError> {
    config.list.iter().enumerate().try_for_each(|(i, effect)| {
        let source = |source| TestbedError::Effect { number: i + 1, kind: effect.kind(), source: Box::new(source) };
        effect.law().check(limits).map_err(source)
    })
}

/// Changes the linear plant as the effects of a checked config do.
pub(crate) fn alter(config: &EffectsConfig, plant: &mut Plant) {
    list(config).iter().for_each(|effect| effect.law().alter(plant));
}

/// The chain of a record under the effects of a checked config.
pub(crate) fn chain(config: &EffectsConfig, truss: &Truss, seed: u64, clock: Clock) -> Chain {
    let mut chain = Chain::default();
    for (i, effect) in list(config).iter().enumerate() {
        // Up to 2^16 effects a record.
        let rng = stream(seed, Purpose::Effect, (clock.record << 16) | i);
        effect.law().install(Site { truss, clock, rng }, &mut chain);
    }
    chain
}
