//! kalmanfilt, filterpy's Kalman filter in Rust: fixed sizes (nalgebra), Joseph's update. `predict` multiplies by F;
//! f(s) then replaces that mean.

use kalmanfilt::kalman::kalman_filter::KalmanFilter;
use nalgebra_033::{Const, SMatrix, SVector, U1};

use crate::joint::Joint;
use crate::peer::{Failure, Peer};
use crate::workload::{CHANNELS, Case};

/// kalmanfilt.
pub struct Kalmanfilt<const N: usize> {
    joint: Joint,
    filter: Box<KalmanFilter<f64, Const<N>, Const<CHANNELS>, U1>>,
}

impl<const N: usize> Kalmanfilt<N> {
    /// For the shapes and the noise of `case`.
    pub fn new(case: &Case) -> Self {
        let mut filter = Box::new(KalmanFilter::default());
        filter.F = SMatrix::zeros();
        filter.Q = SMatrix::zeros();
        filter.H = SMatrix::from_fn(|i, j| if case.rows[i] == j { 1.0 } else { 0.0 });
        filter.R = SMatrix::from_diagonal(&SVector::from_column_slice(&case.sensor));
        Self { joint: Joint::new(case), filter }
    }
}

impl<const N: usize> Peer for Kalmanfilt<N> {
    fn load(&mut self, s: &[f64], p: &[f64]) -> Result<(), Failure> {
        self.filter.x = SVector::from_column_slice(s);
        self.filter.P = SMatrix::from_column_slice(p);
        Ok(())
    }

    fn step(&mut self, z: &[f64; CHANNELS], u: &[f64; CHANNELS]) -> Result<(), Failure> {
        let filter = &mut *self.filter;
        filter.update(&SVector::from_column_slice(z), None, None).map_err(|error| format!("{error:?}"))?;
        let mut s = filter.x;
        self.joint.jacobian(s.as_slice(), u, |i, j, value| filter.F[(i, j)] = value);
        self.joint.process_noise(s.as_slice(), |i, j, value| filter.Q[(i, j)] = value);
        self.joint.advance(s.as_mut_slice(), u);
        filter.predict(None, None, None, None);
        filter.x = s;
        Ok(())
    }

    fn estimate(&self) -> Result<(Vec<f64>, Vec<f64>), Failure> {
        Ok((self.filter.x.as_slice().to_vec(), self.filter.P.as_slice().to_vec()))
    }
}
