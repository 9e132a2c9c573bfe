//! The kinds of plants that a case may have, one file each, in arbitrary units of their outputs.

mod beam;
mod chain;
mod close_modes;
mod drone;
mod truss;

use std::ops::Range;

use rand_chacha::ChaCha12Rng;
use rand_distr::{Distribution, StandardNormal};

use super::spec::PlantKind;
use crate::effects::law::Plant;
use crate::structure::Mode;
use crate::{ACTUATOR_POLE_HZ, INPUTS};

/// A plant as it was drawn.
pub(crate) struct Layout {
    pub plant: Plant,
    /// Modes at which modal effects are drawn, from 0: those that dominate.
    pub dominant: Range<usize>,
    /// Modes of which one may be missing from the simulation, from 0.
    pub missable: Range<usize>,
}

impl Layout {
    /// With the usual actuators.
    fn new(modes: Vec<Mode>, dominant: Range<usize>, missable: Range<usize>) -> Self {
        Self { plant: Plant { modes, poles_hz: [ACTUATOR_POLE_HZ; INPUTS] }, dominant, missable }
    }
}

/// Draws a plant of a kind.
pub(crate) fn layout(kind: PlantKind, rng: &mut ChaCha12Rng) -> Layout {
    match kind {
        PlantKind::Truss => truss::layout(rng),
        PlantKind::Beam => beam::layout(rng),
        PlantKind::Chain => chain::layout(rng),
        PlantKind::Drone => drone::layout(rng),
        PlantKind::CloseModes => close_modes::layout(rng),
    }
}

fn normal(rng: &mut ChaCha12Rng) -> f64 {
    StandardNormal.sample(rng)
}

/// A value with so much relative scatter, never beyond two and a half standard deviations.
fn about(value: f64, std: f64, rng: &mut ChaCha12Rng) -> f64 {
    value * (1.0 + std * normal(rng).clamp(-2.5, 2.5))
}
