//! What every effect of the list can do.

use super::chain::{Chain, Site};
use super::place::ModeNumber;
use crate::config::within;
use crate::error::TestbedError;
use crate::structure::Mode;

/// The linear part of the plant, which linear effects change.
pub(crate) struct Plant {
    pub modes: Vec<Mode>,
    /// Pole of each actuator, Hz.
    pub poles_hz: [f64; crate::INPUTS],
}

/// What the values of an effect are checked against.
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

    /// Adds the effect to a record's chain.
    fn install(&self, _site: Site, _chain: &mut Chain) {}

    /// Makes the effect stronger by a factor: what it changes grows with it, to first order in proportion where
    /// the law allows that.
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
