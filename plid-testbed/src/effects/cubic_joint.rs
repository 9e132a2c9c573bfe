//! A joint that hardens or softens: f = -k d^3 at the strut of one input.

use super::StructureEffect;
use crate::plant::StrutPort;

pub(crate) struct CubicStiffness {
    stiffness_per_v2: f64,
    port: StrutPort,
}

impl CubicStiffness {
    pub(crate) fn new(stiffness_per_v2: f64, port: &StrutPort) -> Self {
        Self { stiffness_per_v2, port: port.clone() }
    }
}

impl StructureEffect for CubicStiffness {
    fn add_rate(&self, _t_s: f64, x: &[f64], rate: &mut [f64]) {
        let d: f64 = self.port.displacement.iter().zip(x).map(|(row, x)| row * x).sum();
        let force = -self.stiffness_per_v2 * d.powi(3);
        for (r, share) in rate.iter_mut().zip(&self.port.force) {
            *r += share * force;
        }
    }
}
