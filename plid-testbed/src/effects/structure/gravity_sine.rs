//! Gravity on an axis that swings: the simulation contains k d, and the axis k sin(d).

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::{not_negative, positive};
use crate::effects::chain::{Chain, Site};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Input;
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;

/// f = k (d - sin(d)), where a displacement of 1 V is 1 rad.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GravitySine {
    /// The input at whose axis it acts.
    pub at: Input,
    /// k, V/rad; positive.
    pub stiffness: f64,
    /// The stiffness of the axis at rest, V/rad. Gravity contributes a part of it, and a spring the rest.
    pub whole: f64,
}

impl Law for GravitySine {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("stiffness", self.stiffness)?;
        not_negative("whole - stiffness", self.whole - self.stiffness)
    }

    fn install(&self, site: Site, chain: &mut Chain) {
        let k = self.stiffness;
        chain.force_at(&site.truss.ports[self.at.0], move |d, _v| k * (d - d.sin()));
    }

    fn strengthen(&mut self, factor: f64) {
        self.stiffness *= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.stiffness]
    }
}

impl Described for GravitySine {
    const FAMILY: Family = Family::NonlinearStructure;
    const AT: At = At::Port;
    const ON: &'static [On] = &[On::Swing];
    const PARAMETERS: &'static [&'static str] = &["k"];

    fn start(draw: &mut Draw<'_>) -> Value {
        let whole = draw.axis().stiffness;
        json!({ "stiffness": 0.3 * whole, "whole": whole })
    }
}
