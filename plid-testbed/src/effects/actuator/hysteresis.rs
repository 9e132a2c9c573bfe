//! Hysteresis of a piezo: u' = u - z, where z follows the voltage until it yields.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::INPUTS;
use crate::config::positive;
use crate::effects::chain::{ActuatorEffect, Chain, Site, Span};
use crate::effects::family::Shape;
use crate::effects::law::{Law, Limits};
use crate::effects::place::Input;
use crate::effects::shapes::Yielding;
use crate::effects::written::{self, Laws};
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;

/// u' = u - z, dz = alpha du - (|du| z + du |z|) / (2 uy), along each step of the held voltage; |z| tends to alpha uy.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActuatorHysteresis {
    /// The input.
    pub at: Input,
    /// alpha; positive.
    pub share: f64,
    /// uy, V; positive.
    pub yield_v: f64,
    /// The curve.
    #[serde(default, with = "written")]
    pub law: Yielding,
}

struct Following {
    input: usize,
    share: f64,
    yield_v: f64,
    law: Yielding,
    z: f64,
    before: f64,
}

impl ActuatorEffect for Following {
    fn apply(&mut self, _span: &Span, u: &mut [[f64; INPUTS]]) {
        for piece in u {
            let voltage = piece[self.input];
            self.z = self.law.step(self.z, self.share, self.share * self.yield_v, voltage - self.before);
            self.before = voltage;
            piece[self.input] = voltage - self.z;
        }
    }
}

impl Law for ActuatorHysteresis {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("share", self.share)?;
        positive("yield_v", self.yield_v)?;
        self.law.check()
    }

    fn install(&self, _site: Site, chain: &mut Chain) {
        let (share, yield_v, law) = (self.share, self.yield_v, self.law);
        chain.actuator.push(Box::new(Following { input: self.at.0, share, yield_v, law, z: 0.0, before: 0.0 }));
    }

    fn strengthen(&mut self, factor: f64) {
        self.share *= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.share, self.yield_v]
    }

    fn own_equation(&self) -> bool {
        self.law == Yielding::BoucWen
    }
}

impl Described for ActuatorHysteresis {
    const FAMILY: Family = Family::NonlinearActuator;
    const AT: At = At::Input;
    const ON: &'static [On] = &[On::Structure];
    const PARAMETERS: &'static [&'static str] = &["alpha", "uy"];
    const NEAR_MISSES: &'static [&'static str] = &["dahl", "sharp"];
    const SHAPES: &'static [Shape] = Yielding::SHAPES;
    const IMPERFECTION: bool = true;

    fn start(draw: &mut Draw<'_>) -> Value {
        json!({ "share": 0.3, "yield_v": draw.within(0.5..1.2) })
    }
}
