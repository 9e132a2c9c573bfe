//! kfilter: fixed sizes (nalgebra). The joint filter is a `System` of its own, as that crate means it to be.

use kfilter::measurement::{LinearMeasurement, Measurement};
use kfilter::system::{InputSystem, LinearisableSystem, System};
use kfilter::{Kalman, KalmanFilter, KalmanPredictInput, KalmanUpdate};
use nalgebra_034::{SMatrix, SVector};

use crate::joint::Joint;
use crate::peer::{Failure, Peer};
use crate::workload::{CHANNELS, Case};

type Square<const N: usize> = SMatrix<f64, N, N>;

struct JointSystem<const N: usize> {
    joint: Joint,
    s: SVector<f64, N>,
    f: Square<N>,
    transposed: Square<N>,
    q: Square<N>,
}

impl<const N: usize> System<f64, N, CHANNELS> for JointSystem<N> {
    fn covariance(&self) -> &Square<N> {
        &self.q
    }
    fn state(&self) -> &SVector<f64, N> {
        &self.s
    }
    fn state_mut(&mut self) -> &mut SVector<f64, N> {
        &mut self.s
    }
}

impl<const N: usize> LinearisableSystem<f64, N, CHANNELS> for JointSystem<N> {
    fn transition(&self) -> &Square<N> {
        &self.f
    }
    fn transition_transpose(&self) -> &Square<N> {
        &self.transposed
    }
}

impl<const N: usize> InputSystem<f64, N, CHANNELS> for JointSystem<N> {
    fn step(&mut self, u: SVector<f64, CHANNELS>) -> &SVector<f64, N> {
        let u = u.into();
        let Self { joint, s, f, transposed, q } = self;
        joint.jacobian(s.as_slice(), &u, |i, j, value| {
            f[(i, j)] = value;
            transposed[(j, i)] = value;
        });
        joint.process_noise(s.as_slice(), |i, j, value| q[(i, j)] = value);
        joint.advance(s.as_mut_slice(), &u);
        s
    }

    fn predict(&self, s: &SVector<f64, N>, u: &SVector<f64, CHANNELS>) -> SVector<f64, N> {
        let mut s = *s;
        self.joint.advance(s.as_mut_slice(), &(*u).into());
        s
    }
}

/// kfilter: P+ = (I - K H) P, made symmetric.
pub struct Kfilter<const N: usize> {
    filter: Box<Kalman<f64, N, CHANNELS, JointSystem<N>>>,
    measurement: LinearMeasurement<f64, N, CHANNELS>,
}

impl<const N: usize> Kfilter<N> {
    /// For the shapes and the noise of `case`.
    pub fn new(case: &Case) -> Self {
        let system = JointSystem {
            joint: Joint::new(case),
            s: SVector::zeros(),
            f: Square::zeros(),
            transposed: Square::zeros(),
            q: Square::zeros(),
        };
        let h = SMatrix::from_fn(|i, j| if case.rows[i] == j { 1.0 } else { 0.0 });
        let r = SMatrix::from_diagonal(&SVector::from_column_slice(&case.sensor));
        Self {
            filter: Box::new(Kalman::new_custom(system, Square::zeros())),
            measurement: LinearMeasurement::new(h, r, SVector::zeros()),
        }
    }
}

impl<const N: usize> Peer for Kfilter<N> {
    fn load(&mut self, s: &[f64], p: &[f64]) -> Result<(), Failure> {
        self.filter.system.s = SVector::from_column_slice(s);
        *self.filter.covariance_mut() = Square::from_column_slice(p);
        Ok(())
    }

    fn step(&mut self, z: &[f64; CHANNELS], u: &[f64; CHANNELS]) -> Result<(), Failure> {
        self.measurement.set_measurement(SVector::from_column_slice(z));
        self.filter.update(&self.measurement).map_err(|error| format!("{error:?}"))?;
        self.filter.predict(SVector::from_column_slice(u)).map_err(|error| format!("{error:?}"))?;
        Ok(())
    }

    fn estimate(&self) -> Result<(Vec<f64>, Vec<f64>), Failure> {
        Ok((self.filter.state().as_slice().to_vec(), self.filter.covariance().as_slice().to_vec()))
    }
}
