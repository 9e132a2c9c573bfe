//! A damper that the simulation lacks: f = -c v at the port of one input.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::positive;
use crate::effects::law::{Law, Limits, Load};
use crate::effects::place::Input;
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;

/// f = -c v.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AddedDamping {
    /// The input at whose port it acts.
    pub at: Input,
    /// c, V s/V; positive.
    pub damping_s: f64,
}

impl Law for AddedDamping {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("damping_s", self.damping_s)
    }

    fn load(&self) -> Option<Load> {
        Some(Load { port: self.at.0, damping: self.damping_s, ..Load::default() })
    }

    fn strengthen(&mut self, factor: f64) {
        self.damping_s *= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.damping_s]
    }
}

impl Described for AddedDamping {
    const FAMILY: Family = Family::LinearStructure;
    const AT: At = At::Port;
    const ON: &'static [On] = &[On::Axis];
    const PARAMETERS: &'static [&'static str] = &["c"];

    fn start(draw: &mut Draw<'_>) -> Value {
        let own = draw.axis();
        // If the axis has no damper, the added one gives a time constant of 1 s.
        json!({ "damping_s": if own.damping > 0.0 { 0.1 * own.damping } else { own.inertia } })
    }
}
