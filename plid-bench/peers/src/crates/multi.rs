//! multicalc: fixed sizes, loops of its own. Its linear filter, since its extended one differentiates f itself.
//! `predict` multiplies by F; f(s) then replaces that mean.

use multicalc::estimation::{KalmanFilter, KalmanModel};
use multicalc::linear_algebra::{Matrix, Vector};

use crate::joint::Joint;
use crate::peer::{Failure, Peer};
use crate::workload::{CHANNELS, Case};

/// multicalc with its default update, Joseph's; with the other, (I - K H) P, P is lost within 40 samples.
pub struct Multicalc<const N: usize> {
    joint: Joint,
    model: Box<KalmanModel<N, CHANNELS>>,
    filter: Box<KalmanFilter<N, CHANNELS>>,
}

impl<const N: usize> Multicalc<N> {
    /// For the shapes and the noise of `case`.
    pub fn new(case: &Case) -> Self {
        let model = Box::new(KalmanModel {
            state_transition: Matrix::zeros(),
            measurement_model: Matrix::from_fn(|i, j| if case.rows[i] == j { 1.0 } else { 0.0 }),
            process_noise: Matrix::zeros(),
            measurement_noise: Matrix::from_fn(|i, j| if i == j { case.sensor[i] } else { 0.0 }),
        });
        let filter = Box::new(KalmanFilter::new(Vector::zeros(), Matrix::zeros(), *model));
        Self { joint: Joint::new(case), model, filter }
    }
}

impl<const N: usize> Peer for Multicalc<N> {
    fn load(&mut self, s: &[f64], p: &[f64]) -> Result<(), Failure> {
        let covariance = Matrix::from_fn(|i, j| p[j * N + i]);
        *self.filter = KalmanFilter::new(Vector::from_fn(|i| s[i]), covariance, *self.model);
        Ok(())
    }

    fn step(&mut self, z: &[f64; CHANNELS], u: &[f64; CHANNELS]) -> Result<(), Failure> {
        let Self { joint, model, filter } = self;
        filter.update(Vector::new(*z)).map_err(|error| format!("{error:?}"))?;
        let mut s = filter.state();
        joint.jacobian(s.as_slice(), u, |i, j, value| model.state_transition[(i, j)] = value);
        joint.process_noise(s.as_slice(), |i, j, value| model.process_noise[(i, j)] = value);
        joint.advance(s.as_mut_slice(), u);
        filter.set_state_transition(model.state_transition);
        filter.set_process_noise(model.process_noise);
        filter.predict();
        filter.set_state(s);
        Ok(())
    }

    fn estimate(&self) -> Result<(Vec<f64>, Vec<f64>), Failure> {
        let covariance = self.filter.covariance();
        let p = (0..N * N).map(|k| covariance[(k % N, k / N)]).collect();
        Ok((self.filter.state().as_slice().to_vec(), p))
    }
}
