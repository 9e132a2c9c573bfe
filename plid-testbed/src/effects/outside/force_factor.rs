//! A moving coil that leaves its magnet: the force per volt falls with the displacement.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::positive;
use crate::effects::chain::{Chain, Site, StructureEffect, add_scaled, dot};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Input;
use crate::effects::{At, Described, Draw, Family, Half, On};
use crate::error::TestbedError;
use crate::plant::StrutPort;

/// The force a of the actuator becomes a / (1 + (d / D)^2), with the displacement d of its own strut. The force
/// factor of a loudspeaker falls in a similar way (Klippel, *J. Audio Eng. Soc.* 54, 2006, 907); the curve is our
/// choice.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ForceFactor {
    /// The input of the actuator.
    pub at: Input,
    /// D, the displacement at which half of the force is left, V; positive.
    pub half_v: f64,
}

struct Coil {
    port: StrutPort,
    /// Index of the actuator's output in the state.
    actuator: usize,
    half: f64,
}

impl StructureEffect for Coil {
    fn add_rate(&self, _t_s: f64, x: &[f64], rate: &mut [f64]) {
        let square = (dot(&self.port.displacement, x) / self.half).powi(2);
        add_scaled(rate, &self.port.force, -x[self.actuator] * square / (1.0 + square));
    }
}

impl Law for ForceFactor {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("half_v", self.half_v)
    }

    fn install(&self, site: Site, chain: &mut Chain) {
        // The outputs of the actuators are the first states of a structure.
        let (port, actuator) = (site.truss.ports[self.at.0].clone(), self.at.0);
        chain.structure.push(Box::new(Coil { port, actuator, half: self.half_v }));
    }

    fn strengthen(&mut self, factor: f64) {
        self.half_v /= factor.sqrt();
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.half_v]
    }
}

impl Described for ForceFactor {
    const FAMILY: Family = Family::Outside(Half::Reported);
    const AT: At = At::Input;
    const ON: &'static [On] = &[On::Structure];

    fn start(draw: &mut Draw<'_>) -> Value {
        json!({ "half_v": 3.0 * draw.level.displacement })
    }
}
