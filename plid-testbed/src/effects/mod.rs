//! Optional effects: what a linear time-invariant model lacks. One file an effect.
//!
//! An effect inside the structure is a [`StructureEffect`], integrated in continuous time together with the structure. One
//! at an actuator or a sensor belongs in the chain of `record.rs`: after the amplifier noise, or between
//! the sampled output and the sensor noise. None of that kind exists yet.

mod cubic_joint;
mod stiffness_drift;

use crate::config::EffectsConfig;
use crate::plant::Truss;

/// An internal force that depends on time and state.
pub(crate) trait StructureEffect {
    /// Adds the force's share of dx/dt at time `t_s` (since the first record began) and state `x`.
    fn add_rate(&self, t_s: f64, x: &[f64], rate: &mut [f64]);
}

/// The effects of a checked config.
pub(crate) fn structure_effects(config: &EffectsConfig, truss: &Truss) -> Vec<Box<dyn StructureEffect>> {
    let mut effects: Vec<Box<dyn StructureEffect>> = Vec::new();
    if config.stiffness_drift_per_s != 0.0 {
        effects.push(Box::new(stiffness_drift::StiffnessDrift::new(config.stiffness_drift_per_s, &truss.modes)));
    }
    if let Some(joint) = &config.cubic_joint {
        effects.push(Box::new(cubic_joint::CubicStiffness::new(joint.stiffness_per_v2, &truss.ports[joint.input - 1])));
    }
    effects
}
