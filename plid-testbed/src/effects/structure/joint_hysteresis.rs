//! A joint that slips: f = -k z, where z follows the displacement until it yields.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::positive;
use crate::effects::chain::{Chain, Site, StructureEffect, add_scaled, dot};
use crate::effects::family::Shape;
use crate::effects::law::{Law, Limits};
use crate::effects::place::Input;
use crate::effects::shapes::Yielding;
use crate::effects::written::{self, Laws};
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;
use crate::plant::StrutPort;

/// f = -k z, dz/dt = v - (|v| z + v |z|) / (2 dy).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointHysteresis {
    /// The input at whose strut it acts.
    pub at: Input,
    /// k, V/V; positive.
    pub stiffness: f64,
    /// dy, V; positive.
    pub yield_v: f64,
    /// The curve.
    #[serde(default, with = "written")]
    pub law: Yielding,
}

struct Slipping {
    port: StrutPort,
    stiffness: f64,
    yield_v: f64,
    law: Yielding,
    /// The index of z in the state.
    state: usize,
}

impl StructureEffect for Slipping {
    fn add_rate(&self, _t_s: f64, x: &[f64], rate: &mut [f64]) {
        let z = x[self.state];
        rate[self.state] += self.law.rate(z, 1.0, self.yield_v, dot(&self.port.velocity, x));
        add_scaled(rate, &self.port.force, -self.stiffness * z);
    }
}

impl Law for JointHysteresis {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("stiffness", self.stiffness)?;
        positive("yield_v", self.yield_v)?;
        self.law.check()
    }

    fn install(&self, site: Site, chain: &mut Chain) {
        let state = site.truss.continuous.states() + chain.own_states;
        chain.own_states += 1;
        let port = site.truss.ports[self.at.0].clone();
        let (stiffness, yield_v, law) = (self.stiffness, self.yield_v, self.law);
        chain.structure.push(Box::new(Slipping { port, stiffness, yield_v, law, state }));
    }

    fn strengthen(&mut self, factor: f64) {
        self.stiffness *= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.stiffness, self.yield_v]
    }

    fn own_equation(&self) -> bool {
        self.law == Yielding::BoucWen
    }
}

impl Described for JointHysteresis {
    const FAMILY: Family = Family::NonlinearStructure;
    const AT: At = At::Port;
    const ON: &'static [On] = &[On::Structure, On::Joint];
    const PARAMETERS: &'static [&'static str] = &["k", "dy"];
    const NEAR_MISSES: &'static [&'static str] = &["dahl", "sharp"];
    const SHAPES: &'static [Shape] = Yielding::SHAPES;
    const IMPERFECTION: bool = true;

    fn start(draw: &mut Draw<'_>) -> Value {
        json!({ "stiffness": 0.01, "yield_v": draw.within(0.4..1.2) * draw.level.displacement })
    }
}
