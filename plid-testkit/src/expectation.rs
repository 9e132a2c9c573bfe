//! What can be asked of any conditional expectation.

use plid_backends::Plain;
use plid_core::{
    ConditionalExpectations, Identifier, InitialCovariance, Inspect, NoiseModel, ObservableForm, Settings,
};
use plid_model::scalar_bayes::{ScalarPrior, ScalarRecord, exact_bayes};
use plid_variants::covariance::{BiermanUd, Direct};
use rand::RngExt;

use crate::case::{normal, rng};
use crate::{allocations, properties};

/// How an expectation does beside exact Bayes on the scalar plant x+ = a x + b u + xi, z = x + w.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    /// Root mean square error of a.
    pub rmse: f64,
    /// The same of the exact posterior mean, which is the least that there is.
    pub exact_rmse: f64,
    /// Mean of the squared error of a over its variance in P: 1 if P tells the accuracy as it is.
    pub nees: f64,
}

const STEPS: usize = 200;
const GRID_POINTS: usize = 120;

/// Runs `E` on `runs` random plants and records with state noise of variance `sigma` and sensor noise of variance `r`.
pub fn grid_bayes<E: ConditionalExpectations<Scalar = f64>>(sigma: f64, r: f64, runs: usize) -> Calibration {
    let prior = ScalarPrior::default();
    let (mut own, mut exact, mut nees) = (0.0, 0.0, 0.0);
    for seed in 0..runs as u64 {
        let mut rng = rng(1000 + seed);
        let (a, b) = prior.draw(|| normal(&mut rng));
        let mut x = normal(&mut rng);
        let (mut z, mut u) = (Vec::new(), Vec::new());
        for _ in 0..STEPS {
            z.push(x + r.sqrt() * normal(&mut rng));
            u.push(if rng.random::<bool>() { 1.0 } else { -1.0 });
            x = a * x + b * u[u.len() - 1] + sigma.sqrt() * normal(&mut rng);
        }
        let record = ScalarRecord { z: &z, u: &u, sensor: r, state: sigma };
        exact += (exact_bayes(&record, &prior, GRID_POINTS).mean[0] - a).powi(2);
        let (found, variance) = filter::<E>(&record, &prior);
        own += (found - a).powi(2);
        nees += (found - a).powi(2) / variance;
    }
    let runs = runs as f64;
    Calibration { rmse: (own / runs).sqrt(), exact_rmse: (exact / runs).sqrt(), nees: nees / runs }
}

/// The estimate of a, and its variance.
fn filter<E: ConditionalExpectations<Scalar = f64>>(record: &ScalarRecord<'_>, prior: &ScalarPrior) -> (f64, f64) {
    let form = ObservableForm::new(&[1], 1).unwrap();
    let settings = Settings {
        initial_covariance: InitialCovariance::Diagonal(vec![prior.state_variance, prior.a.1, prior.b.1]),
        initial_estimate: vec![0.0, prior.a.0, prior.b.0],
        ..Settings::new(&form, 1.0, 1.0)
    };
    let noise = NoiseModel::diagonal(&[record.sensor], &[0.0], &[record.state]);
    let mut run = Identifier::<Direct<Plain<f64>>, E>::new(form, &noise, &settings).unwrap();
    for (&z, &u) in record.z.iter().zip(record.u) {
        run.step(&[z], &[u]).unwrap();
    }
    (run.estimate()[1], run.covariance().dense().at(1, 1))
}

/// Holds a conditional expectation to what any must satisfy. A step allocates nothing. P stays a covariance, forms
/// agree, and checkpoints continue to the same bits. Permuted and rescaled channels permute and rescale the estimate.
/// On a scalar plant its error is no smaller than that of exact Bayes, and smaller than the prior's.
///
/// How good it is beyond that is not judged; [`grid_bayes`] tells.
///
/// # Panics
/// Where it does not conform.
pub fn check_expectation<E: ConditionalExpectations<Scalar = f64>>() {
    allocations::a_step_allocates_nothing::<BiermanUd<Plain<f64>>, E>();
    properties::check_expectation::<E>();
    let (found, prior) = (grid_bayes::<E>(0.1, 0.5, 100), ScalarPrior::default());
    // The truth is drawn at random: over 100 runs an approximation may be lucky by a per cent.
    assert!(found.rmse > 0.97 * found.exact_rmse, "better than exact Bayes, which cannot be: {found:?}");
    assert!(found.rmse < 0.7 * prior.a.1.sqrt(), "the estimate hardly learns from the record: {found:?}");
    assert!(found.nees.is_finite() && found.nees > 0.0, "{found:?}");
}
