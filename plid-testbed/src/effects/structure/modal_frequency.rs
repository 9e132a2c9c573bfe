//! One mode at a different frequency: w -> w (1 + delta), with the same damping ratio and shapes.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::{finite, positive};
use crate::effects::law::{Law, Limits, ModeChange, Plant};
use crate::effects::place::ModeNumber;
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;

/// w_m -> w_m (1 + delta).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModalFrequency {
    /// The mode.
    pub at: ModeNumber,
    /// delta; above -1.
    pub change: f64,
}

impl Law for ModalFrequency {
    fn check(&self, limits: &Limits) -> Result<(), TestbedError> {
        limits.mode(self.at)?;
        finite("change", self.change)?;
        positive("1 + change", 1.0 + self.change)
    }

    fn alter(&self, plant: &mut Plant) {
        plant.modes[self.at.0].frequency_hz *= 1.0 + self.change;
    }

    fn mode_change(&self) -> Option<ModeChange> {
        Some(ModeChange::Frequency(self.change.ln_1p()))
    }

    fn strengthen(&mut self, factor: f64) {
        self.change *= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.change]
    }
}

impl Described for ModalFrequency {
    const FAMILY: Family = Family::LinearStructure;
    const AT: At = At::Mode;
    const ON: &'static [On] = &[On::Structure];
    const PARAMETERS: &'static [&'static str] = &["delta"];

    fn start(draw: &mut Draw<'_>) -> Value {
        json!({ "change": draw.sign * 0.005 })
    }
}
