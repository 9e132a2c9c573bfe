//! The properties of a plant: its channels, and the properties that decide which effects make sense on it.

use super::spec::{Channels, PlantKind};
use crate::effects::{self, On};
use crate::{INPUTS, OUTPUTS};

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
        self.has().contains(&On::Axis)
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

    /// Returns the properties of the plant on which effects depend.
    fn has(self) -> &'static [On] {
        use On::{Axis, Channels, Command, Gain, Joint, Position, Reference, Sensor, Swing};
        match self {
            Self::Truss | Self::Beam | Self::Chain | Self::Drone | Self::CloseModes => &[On::Structure],
            Self::Motor => &[Axis, Command, Gain, Sensor],
            Self::Servo | Self::Slider => &[Axis, Position, Command, Gain, Sensor],
            Self::FreeSlider => &[Axis, Command, Sensor],
            Self::Pendulum => &[Axis, Position, Swing, Command, Gain, Sensor],
            Self::Arm => &[Axis, Position, Joint, Command, Gain, Sensor, Channels],
            Self::SliderLoop | Self::ArmLoop => &[Axis, Position, Reference],
        }
    }

    /// Returns whether there is an effect of this name that makes sense on it. Those that the program has added make
    /// sense everywhere.
    #[must_use]
    pub fn takes(self, effect: &str) -> bool {
        effects::kind(effect).is_some_and(|kind| kind.on.iter().any(|on| self.has().contains(on)))
    }
}
