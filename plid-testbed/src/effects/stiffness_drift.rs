//! A slow change of stiffness: w_m^2 -> w_m^2 (1 + r t) for every mode, t since the first record began.

use super::StructureEffect;
use crate::plant::{modal_force, mode_state};
use crate::structure::Mode;

/// As a modal force -w^2 r t q, continuously in time. The damping force 2 zeta w dq/dt stays as it was, for only the
/// stiffness changes.
pub(crate) struct StiffnessDrift {
    rate_per_s: f64,
    /// Of each mode: natural frequency in rad/s, and how a modal force enters dx/dt.
    modes: Vec<(f64, Vec<f64>)>,
}

impl StiffnessDrift {
    pub(crate) fn new(rate_per_s: f64, modes: &[Mode]) -> Self {
        let modes =
            modes.iter().enumerate().map(|(m, mode)| (mode.angular_frequency(), modal_force(modes, m))).collect();
        Self { rate_per_s, modes }
    }
}

impl StructureEffect for StiffnessDrift {
    fn add_rate(&self, t_s: f64, x: &[f64], rate: &mut [f64]) {
        for (m, (w, entry)) in self.modes.iter().enumerate() {
            let force = -w * self.rate_per_s * t_s * x[mode_state(m)];
            for (r, share) in rate.iter_mut().zip(entry) {
                *r += share * force;
            }
        }
    }
}
