//! The methods that are compared, and the result of a method on one run.

use nalgebra::{DMatrix, DVector};
use plid_catalogue::{CovarianceName, ExpectationName, Variant};
use plid_core::ImplicitModel;

use super::batch::{self, Knowledge};
use super::grid::{ScalarPrior, ScalarRecord, exact_bayes};
use super::prediction_error;
use super::trial::Trial;

/// A method of estimation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Method {
    /// The recursion with this expectation.
    Filter(ExpectationName),
    /// Exact Bayes on a grid with this number of points, with the true noise variances.
    Exact(ScalarPrior, usize),
    /// Exact Bayes on a grid with this number of points, with the noise variances that the filters assume.
    ExactAsTold(ScalarPrior, usize),
    /// Least squares on the preceding outputs and inputs.
    LeastSquares,
    /// Instrumental variables, with past inputs as instruments (scalar plant).
    InstrumentalVariable,
    /// Maximum likelihood from prediction errors, with the true noise variances (scalar plant).
    MaximumLikelihood(ScalarPrior, usize),
    /// Maximum posterior density from prediction errors, with the prior of the filters. The noise covariances are the
    /// true ones if they exist, and the assumed ones otherwise. For the scalar plant the estimate is exact.
    MaximumPosterior(Option<(ScalarPrior, usize)>),
}

impl Method {
    /// Returns the name in tables and files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Filter(expectations) => expectations.as_str(),
            Self::Exact(..) => "exact-bayes",
            Self::ExactAsTold(..) => "exact-bayes-as-told",
            Self::LeastSquares => "batch-least-squares",
            Self::InstrumentalVariable => "batch-instrumental-variable",
            Self::MaximumLikelihood(..) => "batch-maximum-likelihood",
            Self::MaximumPosterior(_) => "batch-maximum-posterior",
        }
    }
}

/// The result of a method on a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// Mean square error of the entries of a_1 .. a_p; NaN if the true plant is not in the model class.
    pub squared_a: f64,
    /// Mean square error of the entries of b_1 .. b_m.
    pub squared_b: f64,
    /// e^T P^-1 e of all parameters, divided by their number; NaN if the method gives no P or there are no true
    /// parameters.
    pub nees: f64,
    /// e^T P^-1 e of a_1 .. a_p only, divided by their number.
    pub nees_a: f64,
    /// The mean variance that the method states for the entries of a_1 .. a_p; NaN if it states none.
    pub variance_a: f64,
    /// Relative free-run error on new inputs; infinite if the model diverges.
    pub free_run: f64,
}

/// Parameters, and their covariance if the method gives one.
type Estimate = (Vec<f64>, Option<DMatrix<f64>>);

/// Runs `method` on `trial`; `None` if the recursion fails or the equations have no solution.
pub fn run(method: Method, trial: &Trial, covariance: CovarianceName) -> Option<Outcome> {
    let (parameters, covariance) = estimate(method, trial, covariance)?;
    if !parameters.iter().all(|x| x.is_finite()) {
        return None;
    }
    let free_run = trial.free_run_error(&parameters);
    let unknown = f64::NAN;
    let mut outcome = Outcome {
        squared_a: unknown,
        squared_b: unknown,
        nees: unknown,
        nees_a: unknown,
        variance_a: unknown,
        free_run,
    };
    let Some(truth) = &trial.truth else { return Some(outcome) };
    let of_a = trial.form.outputs() * trial.form.states();
    let error = DVector::from_iterator(truth.len(), parameters.iter().zip(truth).map(|(x, t)| x - t));
    let mean_square = |part: &[f64]| part.iter().map(|e| e * e).sum::<f64>() / part.len() as f64;
    outcome.squared_a = mean_square(&error.as_slice()[..of_a]);
    outcome.squared_b = mean_square(&error.as_slice()[of_a..]);
    if let Some(covariance) = covariance {
        // A matrix without a Cholesky factor is not a covariance: the run has failed.
        outcome.nees = nees(&error, &covariance)?;
        let part = covariance.view((0, 0), (of_a, of_a)).into_owned();
        outcome.nees_a = nees(&error.rows(0, of_a).into_owned(), &part)?;
        outcome.variance_a = part.diagonal().mean();
    }
    Some(outcome)
}

/// Returns e^T P^-1 e divided by the size of e.
fn nees(error: &DVector<f64>, covariance: &DMatrix<f64>) -> Option<f64> {
    let solved = covariance.clone().cholesky()?.solve(error);
    Some(error.dot(&solved) / error.len() as f64)
}

fn estimate(method: Method, trial: &Trial, covariance: CovarianceName) -> Option<Estimate> {
    let record = |told: bool| {
        let noise = if told { &trial.told } else { trial.true_noise.as_ref()? };
        let (z, u) = (trial.outputs.as_slice()?, trial.inputs.as_slice()?);
        Some(ScalarRecord { z, u, sensor: noise.sensor.at(0, 0), state: noise.state.at(0, 0) })
    };
    let alone = |found: [f64; 2]| (found.to_vec(), None);
    let is_scalar = trial.form.joint_states() == 3;
    match method {
        Method::Filter(expectations) => filter(trial, Variant { covariance, expectations, ..Variant::default() }),
        Method::Exact(prior, points) => Some(bayes(&record(false)?, &prior, points)),
        Method::ExactAsTold(prior, points) => Some(bayes(&record(true)?, &prior, points)),
        Method::LeastSquares if is_scalar => batch::least_squares(&record(false)?).map(alone),
        Method::LeastSquares => Some((prediction_error::least_squares(trial)?, None)),
        Method::InstrumentalVariable => batch::instrumental_variable(&record(false)?).map(alone),
        Method::MaximumLikelihood(prior, points) => {
            Some(alone(batch::most_probable(&record(false)?, &prior, Knowledge::Stable, points)))
        }
        Method::MaximumPosterior(Some((prior, points))) => {
            Some(alone(batch::most_probable(&record(false)?, &prior, Knowledge::Prior, points)))
        }
        Method::MaximumPosterior(None) => {
            // The estimate at the end of the moment-matched recursion, but with the initial state that P0 assumes.
            let n = trial.form.states();
            let variant = Variant { covariance, expectations: ExpectationName::MomentMatched, ..Variant::default() };
            let mut start = trial.settings.initial_estimate[..n].to_vec();
            start.extend(filter(trial, variant)?.0);
            let noise = trial.true_noise.as_ref().unwrap_or(&trial.told);
            let (mut s, covariance) = prediction_error::most_probable(trial, noise, &start)?;
            let size = s.len() - n;
            Some((s.split_off(n), Some(covariance.view((n, n), (size, size)).into_owned())))
        }
    }
}

fn bayes(record: &ScalarRecord<'_>, prior: &ScalarPrior, points: usize) -> Estimate {
    let found = exact_bayes(record, prior, points);
    let [aa, ab, bb] = found.covariance;
    (found.mean.to_vec(), Some(DMatrix::from_row_slice(2, 2, &[aa, ab, ab, bb])))
}

fn filter(trial: &Trial, variant: Variant) -> Option<Estimate> {
    let mut recursion = variant.build(trial.form.clone(), &trial.told, &trial.settings).ok()?;
    let (mut z, mut u) = (vec![0.0; trial.form.outputs()], vec![0.0; trial.form.inputs()]);
    for (outputs, inputs) in trial.outputs.rows().into_iter().zip(trial.inputs.rows()) {
        z.iter_mut().zip(outputs).for_each(|(to, from)| *to = *from);
        u.iter_mut().zip(inputs).for_each(|(to, from)| *to = *from);
        recursion.step(&z, &u, false).ok()?;
    }
    let identified = recursion.identified();
    let (n, joint) = (trial.form.states(), trial.form.joint_states());
    let covariance = DMatrix::from_fn(joint - n, joint - n, |i, j| identified.covariance.at(n + i, n + j));
    Some((identified.parameters(&trial.form), Some(covariance)))
}
