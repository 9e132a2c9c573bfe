//! The kinds of plants that a case may have, one file each, in arbitrary units of their outputs.

mod arm;
mod beam;
mod chain;
mod close_modes;
mod closed_loop;
mod drone;
mod motor;
mod pendulum;
mod servo;
mod slider;
mod truss;

use std::ops::Range;

use rand_chacha::ChaCha12Rng;
use rand_distr::{Distribution, StandardNormal};

use super::rig::Rig;
use super::spec::PlantKind;
use crate::axes::Axes;
use crate::effects::law::Plant;
use crate::structure::Mode;
use crate::{ACTUATOR_POLE_HZ, INPUTS};

/// A plant as it was drawn.
pub(crate) struct Layout {
    pub plant: Plant,
    /// Modes at which modal effects are drawn, from 0: those that dominate.
    pub dominant: Range<usize>,
    /// Modes of which one may be missing from the simulation, from 0; none for axes.
    pub missable: Range<usize>,
    pub rig: Rig,
}

impl Layout {
    /// Creates a structure with the usual actuators.
    fn new(modes: Vec<Mode>, dominant: Range<usize>, missable: Range<usize>) -> Self {
        let plant = Plant::of_modes(modes, [ACTUATOR_POLE_HZ; INPUTS]);
        Self { plant, dominant, missable, rig: Rig::of_structure() }
    }

    fn of_axes(axes: Axes, rig: Rig) -> Self {
        Self { plant: Plant::of_axes(axes), dominant: 0..0, missable: 0..0, rig }
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
        PlantKind::Motor => motor::layout(rng),
        PlantKind::Servo => servo::layout(rng),
        PlantKind::Slider => slider::layout(rng),
        PlantKind::FreeSlider => slider::floating(rng),
        PlantKind::Pendulum => pendulum::layout(rng),
        PlantKind::Arm => arm::layout(rng),
        PlantKind::SliderLoop => closed_loop::of_slider(rng),
        PlantKind::ArmLoop => closed_loop::of_arm(rng),
    }
}

fn normal(rng: &mut ChaCha12Rng) -> f64 {
    StandardNormal.sample(rng)
}

/// Draws a value with the given relative standard deviation, never beyond two and a half standard deviations.
fn about(value: f64, std: f64, rng: &mut ChaCha12Rng) -> f64 {
    value * (1.0 + std * normal(rng).clamp(-2.5, 2.5))
}
