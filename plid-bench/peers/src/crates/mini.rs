//! minikalman: fixed sizes, buffers on the heap, loops of its own. Its extended filter.

use minikalman::extended::builder::{KalmanFilterBuilder, KalmanFilterObservationType, KalmanFilterType};
use minikalman::prelude::*;

use crate::joint::{Joint, make_symmetric};
use crate::peer::{Failure, Peer};
use crate::workload::{CHANNELS, Case};

/// minikalman: P+ = P - K (H P), made symmetric here. Without that the asymmetry grows until P is lost, within 40
/// samples.
pub struct Minikalman<const N: usize> {
    joint: Joint,
    rows: Vec<usize>,
    filter: KalmanFilterType<N, f64>,
    measurement: KalmanFilterObservationType<N, CHANNELS, f64>,
}

impl<const N: usize> Minikalman<N> {
    /// For the shapes and the noise of `case`.
    pub fn new(case: &Case) -> Self {
        let builder = KalmanFilterBuilder::<N, f64>::default();
        let mut measurement = builder.observations().build::<CHANNELS>();
        for (i, &row) in case.rows.iter().enumerate() {
            measurement.observation_jacobian_matrix_mut().as_matrix_mut().set_at(i, row, 1.0);
            measurement.measurement_noise_covariance_mut().as_matrix_mut().set_at(i, i, case.sensor[i]);
        }
        Self { joint: Joint::new(case), rows: case.rows.clone(), filter: builder.build(), measurement }
    }
}

impl<const N: usize> Peer for Minikalman<N> {
    fn load(&mut self, s: &[f64], p: &[f64]) -> Result<(), Failure> {
        self.filter.state_vector_mut().as_matrix_mut().as_mut_slice().copy_from_slice(s);
        self.filter.estimate_covariance_mut().as_matrix_mut().as_mut_slice().copy_from_slice(p);
        Ok(())
    }

    fn step(&mut self, z: &[f64; CHANNELS], u: &[f64; CHANNELS]) -> Result<(), Failure> {
        let Self { joint, rows, filter, measurement } = self;
        measurement.measurement_vector_mut().as_matrix_mut().as_mut_slice().copy_from_slice(z);
        filter.correct_nonlinear(measurement, |state, observation| {
            for (i, &row) in rows.iter().enumerate() {
                observation[i] = state[row];
            }
        });
        make_symmetric(filter.estimate_covariance_mut().as_matrix_mut().as_mut_slice(), N);
        let mut s = filter.state_vector().as_matrix().as_slice().to_vec();
        let f = filter.state_transition_jacobian_mut().as_matrix_mut().as_mut_slice();
        joint.jacobian(&s, u, |i, j, value| f[i * N + j] = value);
        let q = filter.direct_process_noise_mut().as_matrix_mut().as_mut_slice();
        joint.process_noise(&s, |i, j, value| q[i * N + j] = value);
        joint.advance(&mut s, u);
        filter.predict_nonlinear(|_, next| next.as_matrix_mut().as_mut_slice().copy_from_slice(&s));
        Ok(())
    }

    fn estimate(&self) -> Result<(Vec<f64>, Vec<f64>), Failure> {
        let s = self.filter.state_vector().as_matrix().as_slice().to_vec();
        Ok((s, self.filter.estimate_covariance().as_matrix().as_slice().to_vec()))
    }
}
