//! An actuator whose gain changes slowly: u' = u (1 + r t).

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::INPUTS;
use crate::config::finite;
use crate::effects::chain::{ActuatorEffect, Chain, Site, Span};
use crate::effects::family::Shape;
use crate::effects::law::{Law, Limits};
use crate::effects::place::Input;
use crate::effects::shapes::Course;
use crate::effects::written::{self, Laws};
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;

/// u' = u (1 + r t).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActuatorGainDrift {
    /// The input.
    pub at: Input,
    /// r, 1/s; either sign.
    pub rate_per_s: f64,
    /// The course of the change in time.
    #[serde(default, with = "written")]
    pub law: Course,
}

impl ActuatorEffect for ActuatorGainDrift {
    fn apply(&mut self, span: &Span, u: &mut [[f64; INPUTS]]) {
        for (piece, edges) in u.iter_mut().zip(span.edges.windows(2)) {
            // For a linear course, the mean over the piece is the value at its middle.
            let t_s = span.start_s + (edges[0] + edges[1]) / 2.0 * span.sample_s;
            piece[self.at.0] *= 1.0 + self.rate_per_s * self.law.at(t_s);
        }
    }
}

impl Law for ActuatorGainDrift {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        finite("rate_per_s", self.rate_per_s)?;
        self.law.check()
    }

    fn install(&self, _site: Site, chain: &mut Chain) {
        chain.actuator.push(Box::new(self.clone()));
    }

    fn strengthen(&mut self, factor: f64) {
        self.rate_per_s *= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.rate_per_s]
    }

    fn own_equation(&self) -> bool {
        self.law == Course::Linear
    }
}

impl Described for ActuatorGainDrift {
    const FAMILY: Family = Family::Time;
    const AT: At = At::Input;
    const ON: &'static [On] = &[On::Structure, On::Command];
    const PARAMETERS: &'static [&'static str] = &["r"];
    const NEAR_MISSES: &'static [&'static str] = &["settling"];
    const SHAPES: &'static [Shape] = Course::SHAPES;
    const IMPERFECTION: bool = true;

    fn start(draw: &mut Draw<'_>) -> Value {
        json!({ "rate_per_s": draw.sign * 2e-3 })
    }
}
