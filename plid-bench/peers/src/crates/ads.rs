//! adskalman: fixed sizes (nalgebra). Its `predict` multiplies by F; f(s) then replaces that mean.

use adskalman::{CovarianceUpdateMethod, ObservationModel, StateAndCovariance, TransitionModelLinearNoControl};
use nalgebra_035::{Const, SMatrix, SVector};

use crate::joint::Joint;
use crate::peer::{Failure, Peer};
use crate::workload::{CHANNELS, Case};

type Square<const N: usize> = SMatrix<f64, N, N>;

struct Transition<const N: usize> {
    f: Square<N>,
    transposed: Square<N>,
    q: Square<N>,
}

impl<const N: usize> TransitionModelLinearNoControl<f64, Const<N>> for Transition<N> {
    fn F(&self) -> &Square<N> {
        &self.f
    }
    fn FT(&self) -> &Square<N> {
        &self.transposed
    }
    fn Q(&self) -> &Square<N> {
        &self.q
    }
}

struct Observation<const N: usize> {
    h: SMatrix<f64, CHANNELS, N>,
    transposed: SMatrix<f64, N, CHANNELS>,
    r: Square<CHANNELS>,
}

impl<const N: usize> ObservationModel<f64, Const<N>, Const<CHANNELS>> for Observation<N> {
    fn H(&self) -> &SMatrix<f64, CHANNELS, N> {
        &self.h
    }
    fn HT(&self) -> &SMatrix<f64, N, CHANNELS> {
        &self.transposed
    }
    fn R(&self) -> &Square<CHANNELS> {
        &self.r
    }
}

/// adskalman with one of its updates.
pub struct Adskalman<const N: usize> {
    joint: Joint,
    transition: Box<Transition<N>>,
    observation: Observation<N>,
    estimate: Box<StateAndCovariance<f64, Const<N>>>,
    method: CovarianceUpdateMethod,
}

impl<const N: usize> Adskalman<N> {
    /// For the shapes and the noise of `case`.
    pub fn new(case: &Case, method: CovarianceUpdateMethod) -> Self {
        let h = SMatrix::from_fn(|i, j| if case.rows[i] == j { 1.0 } else { 0.0 });
        Self {
            joint: Joint::new(case),
            transition: Box::new(Transition { f: Square::zeros(), transposed: Square::zeros(), q: Square::zeros() }),
            observation: Observation {
                h,
                transposed: h.transpose(),
                r: Square::from_diagonal(&SVector::from_column_slice(&case.sensor)),
            },
            estimate: Box::new(StateAndCovariance::new(SVector::zeros(), Square::zeros())),
            method,
        }
    }
}

impl<const N: usize> Peer for Adskalman<N> {
    fn load(&mut self, s: &[f64], p: &[f64]) -> Result<(), Failure> {
        *self.estimate = StateAndCovariance::new(SVector::from_column_slice(s), Square::from_column_slice(p));
        Ok(())
    }

    fn step(&mut self, z: &[f64; CHANNELS], u: &[f64; CHANNELS]) -> Result<(), Failure> {
        *self.estimate = self.observation.update(&self.estimate, &SVector::from_column_slice(z), self.method)?;
        let mut s = *self.estimate.state();
        let Transition { f, transposed, q } = &mut *self.transition;
        self.joint.jacobian(s.as_slice(), u, |i, j, value| {
            f[(i, j)] = value;
            transposed[(j, i)] = value;
        });
        self.joint.process_noise(s.as_slice(), |i, j, value| q[(i, j)] = value);
        self.joint.advance(s.as_mut_slice(), u);
        *self.estimate = self.transition.predict(&self.estimate);
        *self.estimate.state_mut() = s;
        Ok(())
    }

    fn estimate(&self) -> Result<(Vec<f64>, Vec<f64>), Failure> {
        Ok((self.estimate.state().as_slice().to_vec(), self.estimate.covariance().as_slice().to_vec()))
    }
}
