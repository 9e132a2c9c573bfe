//! Records of the scalar plant x+ = a x + b u + xi, z = x + w, whose exact posterior is known from a grid.

use plid_backends::Plain;
use plid_core::{
    ConditionalExpectations, Identifier, InitialCovariance, Inspect, NoiseModel, ObservableForm, Settings,
};
use plid_model::scalar_bayes::{ScalarPrior, ScalarRecord, exact_bayes};
use plid_variants::covariance::Direct;
use rand::RngExt;

use crate::case::{normal, rng};

/// Samples of a record.
const STEPS: usize = 200;

/// A plant drawn from [`ScalarPrior`], and its record under a random binary input.
#[derive(Clone, Debug)]
pub struct ScalarCase {
    /// The parameter a of the plant.
    pub a: f64,
    sigma: f64,
    r: f64,
    z: Vec<f64>,
    u: Vec<f64>,
}

impl ScalarCase {
    /// Draws a plant and its record with state noise of variance `sigma` and sensor noise of variance `r`.
    pub fn draw(sigma: f64, r: f64, seed: u64) -> Self {
        let mut rng = rng(seed);
        let (a, b) = ScalarPrior::default().draw(|| normal(&mut rng));
        let mut x = normal(&mut rng);
        let (mut z, mut u) = (Vec::new(), Vec::new());
        for _ in 0..STEPS {
            z.push(x + r.sqrt() * normal(&mut rng));
            u.push(if rng.random::<bool>() { 1.0 } else { -1.0 });
            x = a * x + b * u[u.len() - 1] + sigma.sqrt() * normal(&mut rng);
        }
        Self { a, sigma, r, z, u }
    }

    /// Returns the exact posterior mean of a, from a grid with the given number of points per side.
    pub fn exact_mean(&self, points: usize) -> f64 {
        let record = ScalarRecord { z: &self.z, u: &self.u, sensor: self.r, state: self.sigma };
        exact_bayes(&record, &ScalarPrior::default(), points).mean[0]
    }

    /// Returns the estimate of a by the recursion with expectation `E`, and its variance.
    pub fn filtered<E: ConditionalExpectations<Scalar = f64>>(&self) -> (f64, f64) {
        let form = ObservableForm::new(&[1], 1).unwrap();
        let ScalarPrior { a, b, state_variance, .. } = ScalarPrior::default();
        let settings = Settings {
            initial_covariance: InitialCovariance::Diagonal(vec![state_variance, a.1, b.1]),
            initial_estimate: vec![0.0, a.0, b.0],
            ..Settings::new(&form, 1.0, 1.0)
        };
        let noise = NoiseModel::diagonal(&[self.r], &[0.0], &[self.sigma]);
        let mut run = Identifier::<Direct<Plain<f64>>, E>::new(form, &noise, &settings).unwrap();
        for (&z, &u) in self.z.iter().zip(&self.u) {
            run.step(&[z], &[u]).unwrap();
        }
        (run.estimate()[1], run.covariance().dense().at(1, 1))
    }
}
