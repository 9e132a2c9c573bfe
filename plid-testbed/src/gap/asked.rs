//! Of which plants a cause makes sense: a motor has no spring to stiffen, and a beam has no encoder.

use super::spec::{Channels, PlantKind};
use crate::effects::own;
use crate::{INPUTS, OUTPUTS};

/// Effects of axes that a structure is not asked about: a mass, a damper or a spring is what it does to the frequencies
/// and damping ratios of all modes, and nothing on a structure swings or runs against a stop.
const OF_AXES: [&str; 8] = [
    "added-damping",
    "added-mass",
    "added-stiffness",
    "backlash",
    "end-stop",
    "gravity-sine",
    "one-sided-stop",
    "stick-friction",
];

/// Effects that resist any motion.
const RESISTANCE: [&str; 5] =
    ["added-damping", "added-mass", "coulomb-friction", "quadratic-damping", "stick-friction"];
/// Effects that depend on the position of an axis.
const POSITION: [&str; 3] = ["added-stiffness", "end-stop", "one-sided-stop"];
/// Elastic joints.
const JOINT: [&str; 4] = ["backlash", "clearance", "cubic-stiffness", "joint-hysteresis"];
/// Effects between a command and a torque. With one input and one output, a gain, a lag or a delay of the sensor is
/// equivalent, and is not asked about.
const COMMAND: [&str; 10] = [
    "actuator-dead-zone",
    "actuator-delay",
    "actuator-gain",
    "actuator-gain-drift",
    "actuator-lag",
    "actuator-saturation",
    "actuator-slew-limit",
    "x-delay-jitter",
    "x-sticking-valve",
    "x-thermal-gain",
];
/// Effects of a sensor that no controller reads. At rates so far above the motion, a few samples that are
/// lost hardly make a gap.
const SENSOR: [&str; 7] = [
    "sensor-drift",
    "sensor-noise",
    "sensor-offset",
    "sensor-quantisation",
    "x-proportional-noise",
    "x-sensor-rate-limit",
    "x-sensor-square",
];
/// Effects that can be distinguished only with several channels.
const CHANNELS: [&str; 5] = ["actuator-crosstalk", "sensor-crosstalk", "sensor-delay", "sensor-gain", "sensor-lag"];
/// Effects on the reference of a controller.
const REFERENCE: [&str; 4] = ["actuator-delay", "actuator-saturation", "actuator-slew-limit", "x-delay-jitter"];

impl PlantKind {
    /// Every kind of plant.
    pub const ALL: [Self; 13] = [
        Self::Truss,
        Self::Beam,
        Self::Chain,
        Self::Drone,
        Self::CloseModes,
        Self::Motor,
        Self::Servo,
        Self::Slider,
        Self::FreeSlider,
        Self::Pendulum,
        Self::Arm,
        Self::SliderLoop,
        Self::ArmLoop,
    ];

    /// Returns whether it is a body on axes, and not a structure of modes.
    #[must_use]
    pub fn has_axes(self) -> bool {
        !matches!(self, Self::Truss | Self::Beam | Self::Chain | Self::Drone | Self::CloseModes)
    }

    /// Returns its numbers of inputs and outputs.
    #[must_use]
    pub fn channels(self) -> Channels {
        match self {
            Self::Arm | Self::ArmLoop => Channels { inputs: 2, outputs: 2 },
            axis if axis.has_axes() => Channels { inputs: 1, outputs: 1 },
            _ => Channels { inputs: INPUTS, outputs: OUTPUTS },
        }
    }

    /// Returns whether an effect makes sense on it. Those that the program has added make sense everywhere.
    #[must_use]
    pub fn takes(self, effect: &str) -> bool {
        let groups: &[&[&str]] = match self {
            Self::Motor => &[&RESISTANCE, &COMMAND, &SENSOR],
            Self::Servo | Self::Slider => &[&RESISTANCE, &POSITION, &COMMAND, &SENSOR],
            // Without a damper or a spring a gain is a mass.
            Self::FreeSlider if effect == "actuator-gain" => return false,
            Self::FreeSlider => &[&RESISTANCE, &COMMAND, &SENSOR],
            Self::Pendulum => &[&["gravity-sine"], &RESISTANCE, &POSITION, &COMMAND, &SENSOR],
            Self::Arm => &[&JOINT, &RESISTANCE, &POSITION, &COMMAND, &SENSOR, &CHANNELS],
            Self::SliderLoop | Self::ArmLoop => &[&RESISTANCE, &POSITION, &REFERENCE],
            _ => return !OF_AXES.contains(&effect),
        };
        own::find(effect).is_some() || groups.iter().any(|group| group.contains(&effect))
    }
}
