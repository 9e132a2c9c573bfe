//! A joint that slips: f = k (s d - z), where z follows the displacement d until it yields.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::{finite, positive};
use crate::effects::chain::{Chain, Site, StructureEffect, add_scaled, dot};
use crate::effects::family::Shape;
use crate::effects::law::{Law, Limits};
use crate::effects::place::Input;
use crate::effects::shapes::Yielding;
use crate::effects::written::{self, Laws};
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;
use crate::plant::StrutPort;

/// f = k (s d - z), dz/dt = v - (|v| z + v |z|) / (2 dy).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointHysteresis {
    /// The input at whose strut it acts.
    pub at: Input,
    /// k, V/V; positive.
    pub stiffness: f64,
    /// dy, V; positive.
    pub yield_v: f64,
    /// s, the share of k that the plant contains without the effect; the effect removes it.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub held: f64,
    /// The curve.
    #[serde(default, with = "written")]
    pub law: Yielding,
}

fn is_zero(held: &f64) -> bool {
    *held == 0.0
}

struct Slipping {
    port: StrutPort,
    joint: JointHysteresis,
    /// The index of z in the state.
    state: usize,
}

impl StructureEffect for Slipping {
    fn add_rate(&self, _t_s: f64, x: &[f64], rate: &mut [f64]) {
        let JointHysteresis { stiffness, yield_v, held, law, .. } = self.joint;
        let (d, z) = (dot(&self.port.displacement, x), x[self.state]);
        rate[self.state] += law.rate(z, 1.0, yield_v, dot(&self.port.velocity, x));
        add_scaled(rate, &self.port.force, stiffness * (held * d - z));
    }
}

impl Law for JointHysteresis {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("stiffness", self.stiffness)?;
        positive("yield_v", self.yield_v)?;
        finite("held", self.held)?;
        self.law.check()
    }

    fn install(&self, site: Site, chain: &mut Chain) {
        let state = site.truss.continuous.states() + chain.own_states;
        chain.own_states += 1;
        let port = site.truss.ports[self.at.0].clone();
        chain.structure.push(Box::new(Slipping { port, joint: self.clone(), state }));
    }

    fn strengthen(&mut self, factor: f64) {
        self.stiffness *= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        // The vocabulary's equation has s only together with h, which is 1 for this law.
        let held = if self.held == 0.0 { vec![] } else { vec![1.0, self.held] };
        [vec![self.stiffness, self.yield_v], held].concat()
    }

    fn own_equation(&self) -> bool {
        self.law == Yielding::BoucWen
    }
}

impl Described for JointHysteresis {
    const FAMILY: Family = Family::NonlinearStructure;
    const AT: At = At::Port;
    const ON: &'static [On] = &[On::Structure, On::Joint];
    /// The last two are present only if the share is not zero.
    const PARAMETERS: &'static [&'static str] = &["k", "dy", "h", "s"];
    const NEAR_MISSES: &'static [&'static str] = &["dahl", "sharp"];
    const SHAPES: &'static [Shape] = Yielding::SHAPES;
    const IMPERFECTION: bool = true;

    fn start(draw: &mut Draw<'_>) -> Value {
        let yield_v = draw.within(0.4..1.2) * draw.level.displacement;
        // The simulation lacks the joint, or contains it as a spring.
        json!({ "stiffness": 0.01, "yield_v": yield_v, "held": draw.sign.max(0.0) })
    }
}
