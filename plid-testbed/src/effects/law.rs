//! The operations of every effect of the list.

use super::chain::{Chain, Site};
use super::place::ModeNumber;
use crate::axes::Axes;
use crate::config::within;
use crate::error::TestbedError;
use crate::structure::Mode;

/// The linear part of the plant, which linear effects change.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Plant {
    pub modes: Vec<Mode>,
    /// Axes in place of modes.
    pub axes: Option<Axes>,
    /// Pole of each actuator, Hz; infinite where an actuator of an axis has none.
    pub poles_hz: [f64; crate::INPUTS],
}

impl Plant {
    /// Creates a structure of modes.
    pub(crate) fn of_modes(modes: Vec<Mode>, poles_hz: [f64; crate::INPUTS]) -> Self {
        Self { modes, axes: None, poles_hz }
    }

    /// Creates axes without actuator poles.
    pub(crate) fn of_axes(axes: Axes) -> Self {
        Self { modes: Vec::new(), axes: Some(axes), poles_hz: [f64::INFINITY; crate::INPUTS] }
    }

    /// Multiplies the gain from commands to outputs by `gain`.
    pub(crate) fn amplified(mut self, gain: f64) -> Self {
        let scale = gain.sqrt();
        for mode in &mut self.modes {
            // Both shapes of every mode are scaled alike.
            mode.input_shape.iter_mut().for_each(|b| *b *= scale);
            mode.output_shape.iter_mut().for_each(|c| *c *= scale);
        }
        if let Some(axes) = &mut self.axes {
            axes.drive.iter_mut().for_each(|drive| *drive *= gain);
        }
        self
    }
}

/// A force that is linear in the motion of a port: f = -m dv/dt - c v - k d.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Load {
    /// The input at whose port the load acts, from 0.
    pub port: usize,
    /// m, V s^2/V.
    pub mass: f64,
    /// c, V s/V.
    pub damping: f64,
    /// k, V/V.
    pub stiffness: f64,
}

/// The change of one mode by a law, as the logarithm of a factor. The errors of a simulation may change a mode in the
/// same way.
pub(crate) enum ModeChange {
    Frequency(f64),
    Damping(f64),
}

/// The limits against which the values of an effect are checked.
pub(crate) struct Limits {
    pub sample_rate_hz: f64,
    /// End of the last record, s.
    pub end_s: f64,
    pub modes: usize,
}

impl Limits {
    /// Checks that a mode is in the list of modes.
    pub(crate) fn mode(&self, ModeNumber(mode): ModeNumber) -> Result<(), TestbedError> {
        within("at (number of the mode)", mode + 1, 1, self.modes)
    }
}

/// An effect as it was written in a config.
pub(crate) trait Law {
    /// Checks the values; an error names the first key that is wrong.
    fn check(&self, limits: &Limits) -> Result<(), TestbedError>;

    /// Changes the linear plant.
    fn alter(&self, _plant: &mut Plant) {}

    /// Returns the mass, damping and stiffness that the effect adds at a port.
    fn load(&self) -> Option<Load> {
        None
    }

    /// Returns the change of the mode at its place, if the effect changes nothing else.
    fn mode_change(&self) -> Option<ModeChange> {
        None
    }

    /// Adds the effect to a record's chain.
    fn install(&self, _site: Site, _chain: &mut Chain) {}

    /// Makes the effect stronger by a factor. The response grows with the factor, and is proportional to it to first
    /// order where the law allows that.
    fn strengthen(&mut self, factor: f64);

    /// Returns its place for a label: an input, output or mode from 0; the number of inputs stands for all inputs.
    fn place(&self) -> usize;

    /// Returns its parameters for a label, in the order of the vocabulary.
    fn parameters(&self) -> Vec<f64>;

    /// Returns whether its law is the vocabulary's own equation.
    fn own_equation(&self) -> bool {
        true
    }

    /// Returns whether its action in a record follows from its parameters alone, without random numbers.
    fn foretold(&self) -> bool {
        true
    }
}
