//! The plant in closed loop. Its own modes, poles and ports do not change: at each sample, a simulation lets the
//! controller read the outputs and add to the inputs.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use super::Plant;
use crate::case::Controller;
use plid_fourier::C;

/// Lowest frequency, relative to the sample rate, at which the loop is evaluated: integrators have a pole at zero.
const LOWEST: f64 = 1e-9;

/// Gain around the loop within a sample below which it is a rounding error.
const WITHIN_SAMPLE: f64 = 1e-9;

impl Controller {
    /// Returns the frequency response from the plant's outputs to its inputs (m x p).
    fn response(&self, hz: f64, rate: f64) -> DMatrix<C> {
        let z = C::cis(std::f64::consts::TAU * hz / rate);
        let k = self.a.nrows();
        let direct = self.d.map(C::from);
        let shifted = DMatrix::from_diagonal_element(k, k, z) - self.a.map(C::from);
        match shifted.lu().solve(&self.b.map(C::from)) {
            Some(states) if k > 0 => direct + self.c.map(C::from) * states,
            _ => direct,
        }
    }
}

impl Plant {
    /// Closes a loop around the plant. A port whose motion is its input is removed, because the command there is not
    /// known before a run.
    pub fn close(&mut self, controller: Arc<Controller>) {
        self.ports.retain(|port| port.moved_by().is_none());
        self.controller = Some(controller);
    }

    /// Returns whether a command depends on itself within its sample, through the plant and its controller. Effects on
    /// commands and measurements cannot be simulated in such a loop.
    pub fn loops_within_sample(&self) -> bool {
        self.within_sample().is_some_and(|around| around.amax() > WITHIN_SAMPLE)
    }

    /// Returns the gain around the loop within a sample, Dc D (m x m); `None` without a controller.
    pub fn within_sample(&self) -> Option<DMatrix<f64>> {
        let controller = self.controller.as_ref()?;
        Some(&controller.d * self.d.rows(0, controller.d.ncols()))
    }

    /// Returns the sensitivity of the loop at a frequency, (I - P K)^-1 (p x p), by which a disturbance of an output
    /// appears in all outputs; `None` without a controller.
    pub fn sensitivity(&self, hz: f64) -> Option<DMatrix<C>> {
        let controller = self.controller.as_ref()?;
        let hz = hz.max(LOWEST * self.rate);
        let response = controller.response(hz, self.rate);
        // The controller does not read outputs that were added to the plant.
        let feedback = DMatrix::from_fn(self.m, self.p, |i, o| *response.get((i, o)).unwrap_or(&C::ZERO));
        let loop_gain = self.open_response(hz) * feedback;
        (DMatrix::identity(self.p, self.p) - loop_gain).try_inverse()
    }

    /// Returns the frequency response (p x m) for held inputs; in closed loop, for the inputs that are added to the
    /// commands of the controller.
    pub fn response(&self, hz: f64) -> DMatrix<C> {
        let open = self.open_response(hz);
        self.sensitivity(hz).map_or(open.clone(), |sensitivity| sensitivity * open)
    }

    /// Returns the frequency response (p) to a force at a port that is held over each sample.
    pub fn port_response(&self, port: usize, hz: f64) -> DVector<C> {
        let open = self.open_port_response(port, hz);
        self.sensitivity(hz).map_or(open.clone(), |sensitivity| sensitivity * open)
    }
}
