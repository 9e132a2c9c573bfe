//! Effects that the nominal linear time-invariant model lacks, with one file per effect.
//!
//! Each file contains the type of its effect, which implements two traits. `Described` holds what draws of cases and
//! their labels need, such as the family of the effect, its kind of place and the plants on which it makes sense. All
//! other code reads these facts from the table of effects. A new effect needs its file, the two lines that declare
//! and export it (`mod` and `pub use`), and one line in the list `effects!` below.
//!
//! The other trait is `Law`: an effect changes the linear plant, or acts in the chain of a record, either between
//! amplifier and actuator pole, inside the structure (integrated in continuous time together with it), on the samples
//! before the sensor noise, or after the ADC. Effects at one place act in the order of the list. All internal states
//! are zero at the start of a record; clocks and phases run on.

pub mod actuator;
mod at;
#[cfg(test)]
mod axis;
pub(crate) mod chain;
pub mod disturbance;
mod family;
mod kind;
pub(crate) mod law;
#[cfg(test)]
mod oscillator;
pub mod outside;
pub mod own;
pub mod place;
pub mod sensor;
pub mod shapes;
pub mod structure;
mod written;

use serde::{Deserialize, Serialize};

pub use self::at::At;
use self::chain::{Chain, Clock, Site};
pub use self::family::{Families, Halves, Shape};
use self::kind::Entry;
pub(crate) use self::kind::{Described, Draw};
pub use self::kind::{Family, Half, Kind, On};
use self::law::{Law, Limits, Load, Plant};
use self::place::Input;
use crate::config::EffectsConfig;
use crate::error::TestbedError;
use crate::plant::Truss;
use crate::streams::{Purpose, stream};

/// The built-in effects, each with its name in the vocabulary; outsiders' names begin with `x-`.
macro_rules! effects {
    ($($kind:literal = $module:ident::$effect:ident;)*) => {
        /// An effect of the list. In TOML, it is a table with its `kind`, its place `at` and its parameters. Many
        /// effects accept a `law` of the same physics other than the vocabulary's own.
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(tag = "kind")]
        #[allow(missing_docs)] // Each is documented where it is defined.
        pub enum Effect {
            $(#[serde(rename = $kind)] $effect($module::$effect),)*
            #[serde(rename = "own")]
            Own(own::Own),
        }

        impl Effect {
            pub(crate) fn law(&self) -> &dyn Law {
                match self {
                    $(Effect::$effect(effect) => effect,)*
                    Effect::Own(effect) => effect,
                }
            }

            fn law_mut(&mut self) -> &mut dyn Law {
                match self {
                    $(Effect::$effect(effect) => effect,)*
                    Effect::Own(effect) => effect,
                }
            }

            /// Returns its name in the vocabulary; outsiders' names begin with `x-`.
            #[must_use]
            pub fn kind(&self) -> &'static str {
                match self {
                    $(Effect::$effect(_) => $kind,)*
                    Effect::Own(own) => own.name(),
                }
            }
        }

        /// The description of every built-in effect, in the order of the list.
        const BUILT_IN: &[Entry] = &[$(Entry::built_in::<$module::$effect>($kind)),*];
    };
}

// The only list of built-in effects. Trials draw effects in this order, so it is part of the meaning of a seed: first
// the part of the vocabulary that is drawn on structures, then the rest of it, then the outsiders.
effects! {
    "cubic-stiffness" = structure::CubicStiffness;
    "quadratic-stiffness" = structure::QuadraticStiffness;
    "coulomb-friction" = structure::CoulombFriction;
    "clearance" = structure::Clearance;
    "iwan-joint" = structure::IwanJoint;
    "joint-hysteresis" = structure::JointHysteresis;
    "quadratic-damping" = structure::QuadraticDamping;
    "modal-frequency" = structure::ModalFrequency;
    "modal-damping" = structure::ModalDamping;
    "missing-mode" = structure::MissingMode;
    "actuator-saturation" = actuator::ActuatorSaturation;
    "actuator-dead-zone" = actuator::ActuatorDeadZone;
    "actuator-hysteresis" = actuator::ActuatorHysteresis;
    "actuator-slew-limit" = actuator::ActuatorSlewLimit;
    "actuator-lag" = actuator::ActuatorLag;
    "actuator-gain" = actuator::ActuatorGain;
    "actuator-delay" = actuator::ActuatorDelay;
    "actuator-crosstalk" = actuator::ActuatorCrosstalk;
    "sensor-saturation" = sensor::SensorSaturation;
    "sensor-quantisation" = sensor::SensorQuantisation;
    "sensor-dropout" = sensor::SensorDropout;
    "sensor-gain" = sensor::SensorGain;
    "sensor-delay" = sensor::SensorDelay;
    "sensor-lag" = sensor::SensorLag;
    "sensor-crosstalk" = sensor::SensorCrosstalk;
    "sensor-offset" = sensor::SensorOffset;
    "sensor-drift" = sensor::SensorDrift;
    "mains-hum" = sensor::MainsHum;
    "sensor-noise" = sensor::SensorNoise;
    "stiffness-drift" = structure::StiffnessDrift;
    "actuator-gain-drift" = actuator::ActuatorGainDrift;
    "narrowband-disturbance" = disturbance::NarrowbandDisturbance;
    "coloured-disturbance" = disturbance::ColouredDisturbance;
    "added-mass" = structure::AddedMass;
    "added-damping" = structure::AddedDamping;
    "added-stiffness" = structure::AddedStiffness;
    "backlash" = structure::Backlash;
    "end-stop" = structure::EndStop;
    "gravity-sine" = structure::GravitySine;
    "one-sided-stop" = structure::OneSidedStop;
    "stick-friction" = structure::StickFriction;
    "x-channel-product" = outside::ChannelProduct;
    "x-command-play" = outside::CommandPlay;
    "x-delay-jitter" = outside::DelayJitter;
    "x-parametric-stiffness" = outside::ParametricStiffness;
    "x-sensor-rate-limit" = outside::SensorRateLimit;
    "x-sensor-square" = outside::SensorSquare;
    "x-sticking-valve" = outside::StickingValve;
    "x-varying-damping" = outside::VaryingDamping;
    "x-clock-skew" = outside::ClockSkew;
    "x-force-factor" = outside::ForceFactor;
    "x-foreshortening" = outside::Foreshortening;
    "x-intermittent-contact" = outside::IntermittentContact;
    "x-proportional-noise" = outside::ProportionalNoise;
    "x-resonant-crosstalk" = outside::ResonantCrosstalk;
    "x-supply-sag" = outside::SupplySag;
    "x-thermal-gain" = outside::ThermalGain;
}

/// Returns the entries of the built-in effects, in the order of the list, and then those of the effects that the
/// program has added.
fn entries() -> impl Iterator<Item = Entry> {
    BUILT_IN.iter().copied().chain(own::all().into_iter().map(Entry::added))
}

/// Returns the entry of an effect by its name.
pub(crate) fn entry(name: &str) -> Option<Entry> {
    entries().find(|entry| entry.kind.name == name)
}

/// Returns every effect: the vocabulary, the outsiders, and then the effects that the program has added.
#[must_use]
pub fn kinds() -> Vec<Kind> {
    entries().map(|entry| entry.kind).collect()
}

/// Returns an effect by its name.
#[must_use]
pub fn kind(name: &str) -> Option<Kind> {
    entry(name).map(|entry| entry.kind)
}

fn is_built_in(name: &str) -> bool {
    BUILT_IN.iter().any(|entry| entry.kind.name == name)
}

impl Effect {
    /// Returns an effect that changes nothing.
    pub(crate) fn idle() -> Self {
        Effect::ActuatorGain(actuator::ActuatorGain { at: Input(0), gain: 1.0 })
    }

    /// Returns the effect made stronger by a factor. The response grows with the factor, and is proportional to it to
    /// first order where the law allows that.
    #[must_use]
    pub fn strengthened(&self, factor: f64) -> Self {
        let mut stronger = self.clone();
        stronger.law_mut().strengthen(factor);
        stronger
    }

    /// Returns the place for a label, from 0: an input, output or mode; the number of inputs stands for all inputs.
    #[must_use]
    pub fn place(&self) -> usize {
        self.law().place()
    }

    /// Returns the parameters for a label, in the order of the vocabulary.
    #[must_use]
    pub fn parameters(&self) -> Vec<f64> {
        self.law().parameters()
    }

    /// Returns whether its law is the vocabulary's own equation and not a near miss in shape.
    #[must_use]
    pub fn own_equation(&self) -> bool {
        self.law().own_equation()
    }

    /// Returns whether its action in a record follows from its parameters alone, without random numbers.
    #[must_use]
    pub fn foretold(&self) -> bool {
        self.law().foretold()
    }
}

/// Returns the effects of a config in one list, beginning with the two that have their own keys.
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

/// Applies the linear effects of a checked config to the plant.
pub(crate) fn alter(config: &EffectsConfig, plant: &mut Plant) {
    list(config).iter().for_each(|effect| effect.law().alter(plant));
}

/// Returns the masses, dampers and springs that the effects of a checked config add at ports.
pub(crate) fn loads(config: &EffectsConfig) -> Vec<Load> {
    list(config).iter().filter_map(|effect| effect.law().load()).collect()
}

/// Returns the chain of a record with the effects of a checked config.
pub(crate) fn chain(config: &EffectsConfig, truss: &Truss, seed: u64, clock: Clock) -> Chain {
    let mut chain = Chain::default();
    for (i, effect) in list(config).iter().enumerate() {
        // Up to 2^16 effects a record.
        let rng = stream(seed, Purpose::Effect, (clock.record << 16) | i);
        effect.law().install(Site { truss, clock, rng }, &mut chain);
    }
    chain
}
