//! Batch estimates of a plant with several outputs in the same canonical form, by least squares and by prediction
//! errors.

use nalgebra::{DMatrix, DVector};
use ndarray::ArrayView2;
use plid_core::{Dense, ImplicitModel, InitialCovariance, NoiseModel, ObservableForm, Settings};
use plid_lsq::{Damping, Normal, Stop, minimise};
use plid_model::{Model, NoiseCovariances, steady_state_gain};

use super::plants::matrices;
use super::trial::Trial;

/// Number of rows whose normal equations are summed at a time.
const BLOCK: usize = 1000;
/// The starts are near the minimum, so the first step is nearly a Gauss-Newton step.
const DAMPING: Damping = Damping { start: 1e-4, shrink: 0.1, grow: 10.0, least: 0.0, tries: 10, factors: &[1.0] };
/// The cost is half a sum of squared standard errors; smaller decreases do not matter.
const STOP: Stop = Stop { steps: 20, gain: 1e-3, share: 0.0, patience: 1 };
/// A prediction beyond this many standard deviations of the innovation has diverged.
const UNBOUNDED: f64 = 1e8;

/// Estimates by least squares of y_k on the preceding q samples of outputs and inputs, for a form with p equal
/// indices q. The coefficients are the entries of a_i and b_j. The noise in the regressors biases the modes towards
/// more damping.
pub fn least_squares(trial: &Trial) -> Option<Vec<f64>> {
    let (n, m, p) = (trial.form.states(), trial.form.inputs(), trial.form.outputs());
    let each = n / p;
    let size = (p + m) * each;
    let (mut normal, mut right) = (DMatrix::zeros(size, size), DMatrix::zeros(size, p));
    let rows: Vec<usize> = (each..trial.outputs.nrows()).collect();
    for rows in rows.chunks(BLOCK) {
        // Column t q + l of the regressors is signal t, q - l samples earlier.
        let regressors = DMatrix::from_fn(rows.len(), size, |row, column| {
            let (signal, at) = (column / each, rows[row] - each + column % each);
            if signal < p { trial.outputs[(at, signal)] } else { trial.inputs[(at, signal - p)] }
        });
        let y = DMatrix::from_fn(rows.len(), p, |row, i| trial.outputs[(rows[row], i)]);
        // A matrix product is blocked, whereas `tr_mul` uses scalar products.
        let transposed = regressors.transpose();
        normal += &transposed * &regressors;
        right += transposed * y;
    }
    let solution = normal.cholesky()?.solve(&right);
    // This is entry l of block j of the parameter column of signal t.
    let parameters: Vec<f64> = (0..p + m)
        .flat_map(|signal| (0..n).map(move |row| (signal, row)))
        .map(|(signal, row)| solution[(signal * each + row % each, row / each)])
        .collect();
    parameters.iter().all(|x| x.is_finite()).then_some(parameters)
}

/// Returns the joint estimate s with the largest posterior density given a record, found from `start` (N entries),
/// and the inverse of the information there (N x N), which is its covariance if it is Gaussian.
///
/// The recursion approximates this estimate. It has the same prior and the same noise covariances, but processes the
/// record as often as necessary. Predictions are those of the steady-state Kalman filter of the plant that s
/// describes. Gauss-Newton steps with Levenberg-Marquardt damping vary x0 and the parameters. The dependence of the
/// gain on the parameters is part of the cost but not of the gradient. At the true parameters the innovations are
/// white, so the neglected term is zero on average.
pub fn most_probable(trial: &Trial, noise: &NoiseModel, start: &[f64]) -> Option<(Vec<f64>, DMatrix<f64>)> {
    let mut problem = Problem::new(trial, noise);
    let found = minimise(&mut problem, DVector::from_column_slice(start), DAMPING, STOP).ok()?;
    let (information, _) = problem.linearised(&found.point)?;
    Some((found.point.as_slice().to_vec(), information.cholesky()?.inverse()))
}

/// The plant of an estimate has no stable predictor.
struct NoPredictor;

impl plid_lsq::Problem for Problem<'_> {
    type Point = DVector<f64>;
    type Equations = Normal;
    type Error = NoPredictor;

    fn equations(&self) -> Normal {
        Normal::without_memory(self.prior.1.len())
    }

    fn linearise(&mut self, s: &DVector<f64>, equations: &mut Normal) -> Result<(), NoPredictor> {
        (equations.matrix, equations.right) = self.linearised(s).ok_or(NoPredictor)?;
        Ok(())
    }

    fn advance(&self, from: &DVector<f64>, step: &DVector<f64>, to: &mut DVector<f64>) {
        to.copy_from(from);
        *to += step;
    }

    fn cost(&self, s: &DVector<f64>) -> f64 {
        self.surprise(s).unwrap_or(f64::INFINITY)
    }
}

struct Problem<'a> {
    form: &'a ObservableForm,
    inputs: ArrayView2<'a, f64>,
    outputs: ArrayView2<'a, f64>,
    noise: &'a NoiseModel,
    prior: (&'a [f64], Vec<f64>),
}

/// The predictor of the plant with the states and parameters s.
struct Predictor {
    /// A - K C.
    closed: DMatrix<f64>,
    gain: DMatrix<f64>,
    /// The inverse of the lower factor of the innovations' covariance.
    whitener: DMatrix<f64>,
    /// ln det of that covariance.
    log_determinant: f64,
}

fn matrix(dense: &Dense<f64>) -> DMatrix<f64> {
    DMatrix::from_fn(dense.rows(), dense.columns(), |i, j| dense.at(i, j))
}

impl<'a> Problem<'a> {
    fn new(trial: &'a Trial, noise: &'a NoiseModel) -> Self {
        let Settings { initial_covariance, initial_estimate, .. } = &trial.settings;
        let variances = match initial_covariance {
            InitialCovariance::Diagonal(d) => d.clone(),
            InitialCovariance::Full(p0) => (0..p0.rows()).map(|i| p0.at(i, i)).collect(),
        };
        let (inputs, outputs) = (trial.inputs.view(), trial.outputs.view());
        Self { form: &trial.form, inputs, outputs, noise, prior: (initial_estimate, variances) }
    }

    fn predictor(&self, s: &DVector<f64>) -> Option<Predictor> {
        let (n, m, p) = (self.form.states(), self.form.inputs(), self.form.outputs());
        let (a, c) = matrices(self.form, &s.as_slice()[n..]);
        let b = DMatrix::from_column_slice(n, m, &s.as_slice()[(1 + p) * n..]);
        let process = matrix(&self.noise.state) + &b * matrix(&self.noise.actuator) * b.transpose();
        let covariances = NoiseCovariances::independent(process, matrix(&self.noise.sensor));
        let model = Model::new(1.0, a, b, c, DMatrix::zeros(p, m)).ok()?;
        let steady = steady_state_gain(&model, &covariances).ok()?;
        let innovation = &model.c * &steady.covariance * model.c.transpose() + covariances.sensor;
        let factor = innovation.cholesky()?.unpack();
        Some(Predictor {
            closed: &model.a - &steady.gain * &model.c,
            log_determinant: factor.diagonal().iter().map(|d| 2.0 * d.ln()).sum(),
            whitener: factor.try_inverse()?,
            gain: steady.gain,
        })
    }

    /// Predicts over the record and passes x and the whitened innovation of every sample to `each`. Returns `None` if
    /// the predictor diverges.
    fn predict(
        &self,
        s: &DVector<f64>,
        predictor: &Predictor,
        mut each: impl FnMut(usize, &[f64], &[f64]),
    ) -> Option<()> {
        let (n, p) = (self.form.states(), self.form.outputs());
        let rows = self.form.output_states();
        let mut x = s.as_slice()[..n].to_vec();
        let (mut y, mut e, mut white) = (vec![0.0; p], vec![0.0; p], vec![0.0; p]);
        for (k, (z, u)) in self.outputs.rows().into_iter().zip(self.inputs.rows()).enumerate() {
            for i in 0..p {
                y[i] = x[rows[i]];
                e[i] = z[i] - y[i];
            }
            for i in 0..p {
                white[i] = (0..=i).map(|j| predictor.whitener[(i, j)] * e[j]).sum();
            }
            if !white.iter().all(|w| w.abs() < UNBOUNDED) {
                return None;
            }
            each(k, &x, &white);
            self.form.shift(&mut x);
            for (column, &by) in s.as_slice()[n..].chunks_exact(n).zip(y.iter().chain(u)) {
                x.iter_mut().zip(column).for_each(|(x, c)| *x += by * c);
            }
            for i in 0..p {
                x.iter_mut().zip(predictor.gain.column(i).iter()).for_each(|(x, g)| *x += e[i] * g);
            }
        }
        Some(())
    }

    /// Returns the negative logarithm of the posterior density, up to a constant, or `None` if the plant has no
    /// stable predictor.
    fn surprise(&self, s: &DVector<f64>) -> Option<f64> {
        let predictor = self.predictor(s)?;
        let mut squares = self.outputs.nrows() as f64 * predictor.log_determinant;
        self.predict(s, &predictor, |_, _, e| squares += e.iter().map(|e| e * e).sum::<f64>())?;
        let (mean, variances) = &self.prior;
        squares += s.iter().zip(*mean).zip(variances).map(|((s, m), v)| (s - m).powi(2) / v).sum::<f64>();
        Some(0.5 * squares)
    }

    /// Computes A - K C (`closed`, n x n) times a state.
    fn advance(&self, closed: &DMatrix<f64>, state: &[f64], next: &mut [f64]) {
        // A - K C differs from the shift only in the columns of the outputs.
        next.copy_from_slice(state);
        self.form.shift(next);
        for &row in self.form.output_states() {
            let by = state[row];
            for (r, next) in next.iter_mut().enumerate() {
                let structural = if self.form.shift_source(r) == Some(row) { 1.0 } else { 0.0 };
                *next += by * (closed[(r, row)] - structural);
            }
        }
    }

    /// Returns the normal matrix and the right-hand side of a Gauss-Newton step at s.
    ///
    /// The derivative of the prediction with respect to entry r of a parameter column is the response of A - K C to
    /// the regressor of this column (the prediction of an output, or an input) at state r. Within a block, an input
    /// to one state is an input to the next state one sample later, so only the last state of each block needs a
    /// filter, and the responses for the others are its past values. x0 is treated as a regressor that is one before
    /// the first sample.
    fn linearised(&self, s: &DVector<f64>) -> Option<(DMatrix<f64>, DVector<f64>)> {
        let (n, m, p) = (self.form.states(), self.form.inputs(), self.form.outputs());
        let predictor = self.predictor(s)?;
        let size = s.len();
        let (mean, variances) = &self.prior;
        let mut normal = DMatrix::from_diagonal(&DVector::from_iterator(size, variances.iter().map(|v| 1.0 / v)));
        let mut right = DVector::from_iterator(size, (0..size).map(|i| (mean[i] - s[i]) / variances[i]));
        let rows = self.form.output_states();
        let longest = *self.form.indices().iter().max()?;
        // The state of each filter (regressor t, block i), and its last `longest` whitened responses with the newest
        // last.
        let regressors = 1 + p + m;
        let mut states = vec![vec![0.0; n]; regressors * p];
        for (i, &row) in rows.iter().enumerate() {
            states[i][row] = 1.0;
        }
        let mut past = vec![vec![0.0; longest * p]; regressors * p];
        let samples = self.outputs.nrows();
        let mut jacobian = DMatrix::zeros(BLOCK.min(samples) * p, size);
        let mut errors = DVector::zeros(BLOCK.min(samples) * p);
        let block_of: Vec<usize> = (0..n).map(|r| rows.iter().position(|&row| r <= row).unwrap_or(0)).collect();
        let mut filled = 0;
        let mut gather = |jacobian: &DMatrix<f64>, errors: &DVector<f64>, filled: usize| {
            let transposed = jacobian.rows(0, filled).transpose();
            normal += &transposed * jacobian.rows(0, filled);
            right += transposed * errors.rows(0, filled);
        };
        let mut next = vec![0.0; n];
        self.predict(s, &predictor, |k, x, e| {
            for (filter, (state, past)) in states.iter_mut().zip(&mut past).enumerate() {
                past.copy_within(p.., 0);
                for i in 0..p {
                    past[(longest - 1) * p + i] = (0..=i).map(|j| predictor.whitener[(i, j)] * state[rows[j]]).sum();
                }
                self.advance(&predictor.closed, state, &mut next);
                let (regressor, block) = (filter / p, filter % p);
                next[rows[block]] += match regressor {
                    0 => 0.0,
                    t if t <= p => x[rows[t - 1]],
                    t => self.inputs[(k, t - 1 - p)],
                };
                state.copy_from_slice(&next);
            }
            for column in 0..size {
                let (regressor, r) = (column / n, column % n);
                let delay = rows[block_of[r]] - r;
                let past = &past[regressor * p + block_of[r]];
                for i in 0..p {
                    jacobian[(filled + i, column)] = past[(longest - 1 - delay) * p + i];
                }
            }
            errors.rows_mut(filled, p).copy_from_slice(e);
            filled += p;
            if filled == jacobian.nrows() {
                gather(&jacobian, &errors, filled);
                filled = 0;
            }
        })?;
        gather(&jacobian, &errors, filled);
        Some((normal, right))
    }
}

#[cfg(test)]
mod tests {
    use super::super::batch::{self, Knowledge};
    use super::super::grid::{ScalarPrior, ScalarRecord, exact_bayes};
    use super::super::plants::{Loudness, in_class, scalar};
    use super::*;

    fn loudness(signal_to_noise: f64) -> Loudness {
        Loudness { signal_to_noise, state_share: 0.2, told_factor: 1.0 }
    }

    #[test]
    fn least_squares_is_exact_without_noise() {
        let form = ObservableForm::new(&[3, 3], 2).unwrap();
        let trial = in_class(&form, loudness(1e7), 0.5, 200, 2);
        let found = least_squares(&trial).unwrap();
        for (f, t) in found.iter().zip(trial.truth.as_ref().unwrap()) {
            assert!((f - t).abs() < 1e-4, "{f} for {t}");
        }
    }

    /// Compares the derivative with finite differences of the whitened predictions, for a plant whose gain is zero.
    #[test]
    fn the_normal_equations_are_those_of_the_numerical_derivative() {
        let form = ObservableForm::new(&[2, 2], 1).unwrap();
        let trial = in_class(&form, Loudness { state_share: 0.0, ..loudness(3.0) }, 0.05, 30, 11);
        let noise = trial.true_noise.clone().unwrap();
        let problem = Problem::new(&trial, &noise);
        let s = DVector::from_iterator(16, [0.3, -0.2, 0.1, 0.4].into_iter().chain(trial.truth.clone().unwrap()));
        let errors = |s: &DVector<f64>| {
            let mut all = Vec::new();
            problem.predict(s, &problem.predictor(s).unwrap(), |_, _, e| all.extend_from_slice(e)).unwrap();
            DVector::from_vec(all)
        };
        let step = 1e-5;
        let columns: Vec<DVector<f64>> = (0..16)
            .map(|i| {
                let at = |by: f64| {
                    let mut s = s.clone();
                    s[i] += by;
                    errors(&s)
                };
                (at(-step) - at(step)) / (2.0 * step)
            })
            .collect();
        let jacobian = DMatrix::from_columns(&columns);
        let precision = DMatrix::from_diagonal(&DVector::from_iterator(16, problem.prior.1.iter().map(|v| 1.0 / v)));
        let offset = DVector::from_iterator(16, (0..16).map(|i| problem.prior.0[i] - s[i]));
        let (normal, right) = problem.linearised(&s).unwrap();
        let expected = jacobian.tr_mul(&jacobian) + &precision;
        assert!((&normal - &expected).norm() < 1e-6 * expected.norm(), "{normal} {expected}");
        let expected = jacobian.tr_mul(&errors(&s)) + precision * offset;
        assert!((&right - &expected).norm() < 1e-6 * expected.norm());
    }

    /// For the scalar plant, the estimate is the exact maximum a posteriori, apart from the transient of the filter.
    #[test]
    fn of_the_scalar_plant_it_is_the_peak_of_the_posterior() {
        let prior = ScalarPrior::default();
        for seed in 0..5 {
            let trial = scalar(&prior, loudness(2.0), 2000, seed);
            let noise = trial.true_noise.clone().unwrap();
            let (found, covariance) = most_probable(&trial, &noise, &trial.settings.initial_estimate).unwrap();
            let (z, u) = (trial.outputs.as_slice().unwrap(), trial.inputs.as_slice().unwrap());
            let record = ScalarRecord { z, u, sensor: noise.sensor.at(0, 0), state: noise.state.at(0, 0) };
            let exact = batch::most_probable(&record, &prior, Knowledge::Prior, 40);
            // The gradient neglects the dependence of the gain, which moves the result by a fraction of a standard
            // deviation.
            let [aa, _, bb] = exact_bayes(&record, &prior, 60).covariance;
            let off = [(found[1] - exact[0]) / aa.sqrt(), (found[2] - exact[1]) / bb.sqrt()];
            assert!(off.iter().all(|x| x.abs() < 0.6), "{off:?}");
            let ratios = [covariance[(1, 1)] / aa, covariance[(2, 2)] / bb];
            assert!(ratios.iter().all(|r| (0.7..1.5).contains(r)), "{ratios:?}");
        }
    }
}
