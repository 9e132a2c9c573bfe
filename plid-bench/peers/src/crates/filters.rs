//! kalman_filters: sizes at run time, loops of its own over row-major vectors. Its extended Kalman filter.

use kalman_filters::{ExtendedKalmanFilter, ExtendedKalmanFilterBuilder, NonlinearSystem};

use crate::joint::Joint;
use crate::peer::{Failure, Peer};
use crate::workload::{CHANNELS, Case};

struct JointSystem {
    joint: Joint,
    rows: Vec<usize>,
    size: usize,
}

fn input(control: Option<&[f64]>) -> &[f64; CHANNELS] {
    control.and_then(|u| u.try_into().ok()).expect("a step sets the input first")
}

impl NonlinearSystem<f64> for JointSystem {
    fn state_transition(&self, state: &[f64], control: Option<&[f64]>, _dt: f64) -> Vec<f64> {
        let mut s = state.to_vec();
        self.joint.advance(&mut s, input(control));
        s
    }
    fn measurement(&self, state: &[f64]) -> Vec<f64> {
        self.rows.iter().map(|&row| state[row]).collect()
    }
    fn state_jacobian(&self, state: &[f64], control: Option<&[f64]>, _dt: f64) -> Vec<f64> {
        let mut f = vec![0.0; self.size * self.size];
        self.joint.jacobian(state, input(control), |i, j, value| f[i * self.size + j] = value);
        f
    }
    fn measurement_jacobian(&self, _state: &[f64]) -> Vec<f64> {
        let mut h = vec![0.0; CHANNELS * self.size];
        for (i, row) in self.rows.iter().enumerate() {
            h[i * self.size + row] = 1.0;
        }
        h
    }
    fn state_dim(&self) -> usize {
        self.size
    }
    fn measurement_dim(&self) -> usize {
        CHANNELS
    }
}

/// kalman_filters: P+ = (I - K H) P.
pub struct KalmanFilters {
    size: usize,
    filter: ExtendedKalmanFilter<f64, JointSystem>,
}

impl KalmanFilters {
    /// For the shapes and the noise of `case`.
    pub fn new(case: &Case) -> Result<Self, Failure> {
        let size = case.joint;
        let system = JointSystem { joint: Joint::new(case), rows: case.rows.clone(), size };
        let mut r = vec![0.0; CHANNELS * CHANNELS];
        for (i, variance) in case.sensor.iter().enumerate() {
            r[i * CHANNELS + i] = *variance;
        }
        let filter = ExtendedKalmanFilterBuilder::new(system)
            .initial_state(vec![0.0; size])
            .initial_covariance(vec![0.0; size * size])
            .process_noise(vec![0.0; size * size])
            .measurement_noise(r)
            .dt(1.0)
            .build()
            .map_err(|error| format!("{error:?}"))?;
        Ok(Self { size, filter })
    }
}

impl Peer for KalmanFilters {
    fn load(&mut self, s: &[f64], p: &[f64]) -> Result<(), Failure> {
        self.filter.x = s.to_vec();
        self.filter.P = p.to_vec();
        Ok(())
    }

    fn step(&mut self, z: &[f64; CHANNELS], u: &[f64; CHANNELS]) -> Result<(), Failure> {
        let (filter, size) = (&mut self.filter, self.size);
        filter.update(z).map_err(|error| format!("{error:?}"))?;
        filter.system.joint.process_noise(&filter.x, |i, j, value| filter.Q[i * size + j] = value);
        filter.set_control(u.to_vec());
        filter.predict();
        Ok(())
    }

    fn estimate(&self) -> Result<(Vec<f64>, Vec<f64>), Failure> {
        Ok((self.filter.x.clone(), self.filter.P.clone()))
    }
}
