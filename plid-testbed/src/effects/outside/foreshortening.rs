//! A part that becomes shorter as it bends, and so pulls at another part: two struts coupled by their geometry.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::{not_negative, positive};
use crate::effects::chain::{Chain, Site, StructureEffect, add_scaled, dot};
use crate::effects::law::{Law, Limits};
use crate::effects::place::InputPair;
use crate::effects::{At, Described, Draw, Family, Half, On};
use crate::error::TestbedError;
use crate::plant::StrutPort;

/// A spring k, which is a part of the stiffness of strut b, is stretched by e = d_b + d_a^2 / (2 L) instead of d_b.
/// In addition to the linear force -k d_b, which the plant already contains, it exerts f_b = -k (e - d_b) and f_a =
/// -k e d_a / L. Both follow from the energy k e^2 / 2.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Foreshortening {
    /// From the input a, whose strut bends, to the input b, whose strut is pulled.
    pub at: InputPair,
    /// L, V; positive.
    pub length_v: f64,
    /// k, V/V; positive, at most 1, which is all of the stiffness.
    pub stiffness: f64,
}

struct Bent {
    bends: StrutPort,
    pulled: StrutPort,
    length: f64,
    stiffness: f64,
}

impl StructureEffect for Bent {
    fn add_rate(&self, _t_s: f64, x: &[f64], rate: &mut [f64]) {
        let (a, b) = (dot(&self.bends.displacement, x), dot(&self.pulled.displacement, x));
        let shorter = a * a / (2.0 * self.length);
        add_scaled(rate, &self.pulled.force, -self.stiffness * shorter);
        add_scaled(rate, &self.bends.force, -self.stiffness * (b + shorter) * a / self.length);
    }
}

impl Law for Foreshortening {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("length_v", self.length_v)?;
        positive("stiffness", self.stiffness)?;
        not_negative("1 - stiffness", 1.0 - self.stiffness)
    }

    fn install(&self, site: Site, chain: &mut Chain) {
        let InputPair(from, to) = self.at;
        let (bends, pulled) = (site.truss.ports[from].clone(), site.truss.ports[to].clone());
        chain.structure.push(Box::new(Bent { bends, pulled, length: self.length_v, stiffness: self.stiffness }));
    }

    fn strengthen(&mut self, factor: f64) {
        self.length_v /= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.length_v, self.at.1 as f64, self.stiffness]
    }
}

impl Described for Foreshortening {
    const FAMILY: Family = Family::Outside(Half::Reported);
    const AT: At = At::InputPair;
    const ON: &'static [On] = &[On::Structure];

    fn start(draw: &mut Draw<'_>) -> Value {
        json!({ "length_v": 3.0 * draw.level.displacement, "stiffness": draw.within(0.2..0.6) })
    }
}
