//! plid itself, in each of its covariance forms.

use plid_core::{CovariancePropagation, Dense, Identifier, InitialCovariance, Inspect, Settings};
use plid_variants::expectations::JointEkf;

use crate::peer::{Failure, Peer};
use crate::workload::{CHANNELS, Case};

/// plid with the joint EKF and covariance form `C`.
pub struct Plid<C: CovariancePropagation> {
    case: Case,
    identifier: Identifier<C, JointEkf<f64>>,
}

impl<C: CovariancePropagation<Scalar = f64>> Plid<C> {
    /// For the shapes and the noise of `case`.
    pub fn new(case: &Case) -> Result<Self, Failure> {
        let identifier = Identifier::new(case.form.clone(), &case.noise, &case.settings)?;
        Ok(Self { case: case.clone(), identifier })
    }
}

impl<C: Inspect + CovariancePropagation<Scalar = f64>> Peer for Plid<C> {
    fn load(&mut self, s: &[f64], p: &[f64]) -> Result<(), Failure> {
        let joint = self.case.joint;
        let settings = Settings {
            initial_estimate: s.to_vec(),
            initial_covariance: InitialCovariance::Full(Dense::from_fn(joint, joint, |i, j| p[j * joint + i])),
            ..self.case.settings.clone()
        };
        self.identifier = Identifier::new(self.case.form.clone(), &self.case.noise, &settings)?;
        Ok(())
    }

    fn step(&mut self, z: &[f64; CHANNELS], u: &[f64; CHANNELS]) -> Result<(), Failure> {
        Ok(self.identifier.step(z, u)?)
    }

    fn estimate(&self) -> Result<(Vec<f64>, Vec<f64>), Failure> {
        let s = self.identifier.estimate().to_vec();
        Ok((s, self.identifier.covariance().dense().data().to_vec()))
    }
}
