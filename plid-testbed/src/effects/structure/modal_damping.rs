//! One mode with a different damping ratio: zeta -> rho zeta.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::positive;
use crate::effects::law::{Law, Limits, ModeChange, Plant};
use crate::effects::place::ModeNumber;
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;

/// Largest factor, with which a mode hardly moves. The computation of the exponential would not terminate for a
/// matrix of 1e300.
const MOST: f64 = 1e6;

/// zeta_m -> rho zeta_m.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModalDamping {
    /// The mode.
    pub at: ModeNumber,
    /// rho; positive.
    pub factor: f64,
}

impl Law for ModalDamping {
    fn check(&self, limits: &Limits) -> Result<(), TestbedError> {
        limits.mode(self.at)?;
        positive("factor", self.factor)?;
        if self.factor > MOST {
            return Err(TestbedError::TooLarge { key: "factor", value: self.factor, most: MOST });
        }
        Ok(())
    }

    fn alter(&self, plant: &mut Plant) {
        plant.modes[self.at.0].damping_ratio *= self.factor;
    }

    fn mode_change(&self) -> Option<ModeChange> {
        Some(ModeChange::Damping(self.factor.ln()))
    }

    fn strengthen(&mut self, factor: f64) {
        // The strength acts on the logarithm, so the damping stays positive however strong the effect is.
        self.factor = self.factor.powf(factor);
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.factor]
    }
}

impl Described for ModalDamping {
    const FAMILY: Family = Family::LinearStructure;
    const AT: At = At::Mode;
    const ON: &'static [On] = &[On::Structure];
    const PARAMETERS: &'static [&'static str] = &["rho"];

    fn start(draw: &mut Draw<'_>) -> Value {
        json!({ "factor": (draw.sign * 0.3_f64).exp() })
    }
}
