//! The gain of the steady-state predictor x_{k+1} = A x_k + B u_k + K e_k with fixed A, B and C.
//!
//! The noise covariances that give a good simulation model are seldom those that give a good one-step predictor,
//! because model error acts on a prediction like noise. K is therefore fitted to one-step errors: first as the
//! steady-state Kalman gain over a set of state noise levels, then by Gauss-Newton iteration on K itself.

use std::convert::Infallible;

use nalgebra::{DMatrix, DVector};
use ndarray::{ArrayView1, ArrayView2};
use plid_lsq::{Damping, Normal, Problem, Stop, minimise};
use rayon::prelude::*;

use plid_model::{Model, NoiseCovariances, steady_state_gain};

use crate::{Record, Start};

/// A predictor gain and its origin.
#[derive(Clone, Debug, PartialEq)]
pub struct Predictor {
    /// The gain K (n x p).
    pub gain: DMatrix<f64>,
    /// RMS of the one-step error on the scoring part of the training data, one per output.
    pub score: Vec<f64>,
    /// The method that gave K, in words.
    pub origin: String,
}

/// Number of initial samples excluded while the state of the predictor converges.
const SETTLING: usize = 50;
/// Largest number of samples used by the Gauss-Newton steps; more do not improve the gain.
const ENOUGH: usize = 30_000;
/// Number of Gauss-Newton steps.
const STEPS: usize = 12;

/// A predictor with its state at a sample.
struct Course<'a> {
    model: &'a Model,
    /// The entries of A that are not zero, with their rows and columns. Canonical and block-diagonal forms have few.
    entries: Vec<(usize, usize, f64)>,
    gain: &'a DMatrix<f64>,
    state: DVector<f64>,
    next: DVector<f64>,
    input: DVector<f64>,
    innovation: DVector<f64>,
}

impl<'a> Course<'a> {
    fn new(model: &'a Model, gain: &'a DMatrix<f64>, x0: &DVector<f64>) -> Self {
        let (input, innovation) = (DVector::zeros(model.m()), DVector::zeros(model.p()));
        let entries = (0..model.n()).flat_map(|j| (0..model.n()).map(move |i| (i, j)));
        let entries = entries.map(|(i, j)| (i, j, model.a[(i, j)])).filter(|entry| entry.2 != 0.0).collect();
        Self { model, entries, gain, state: x0.clone(), next: x0.clone(), input, innovation }
    }

    /// Takes the outputs `z` and inputs `u` of the sample. Returns e = z - C x - D u, zero where z is missing.
    fn innovation(&mut self, z: ArrayView1<'_, f64>, u: ArrayView1<'_, f64>) -> &DVector<f64> {
        self.input.iter_mut().zip(u).for_each(|(to, u)| *to = *u);
        self.innovation.gemv(-1.0, &self.model.c, &self.state, 0.0);
        self.innovation.gemv(-1.0, &self.model.d, &self.input, 1.0);
        for (e, z) in self.innovation.iter_mut().zip(z) {
            *e = if z.is_finite() { *e + z } else { 0.0 };
        }
        &self.innovation
    }

    /// Goes on to the next sample.
    fn advance(&mut self) {
        self.next.gemv(1.0, &self.model.b, &self.input, 0.0);
        self.entries.iter().for_each(|&(i, j, entry)| self.next[i] += entry * self.state[j]);
        self.next.gemv(1.0, self.gain, &self.innovation, 1.0);
        std::mem::swap(&mut self.state, &mut self.next);
    }
}

/// Returns the mean square one-step error of each output with the initial state `x0`, and the final state. The error
/// is infinite if the predictor diverges.
fn one_step(model: &Model, gain: &DMatrix<f64>, record: Record<'_>, x0: &DVector<f64>) -> (Vec<f64>, DVector<f64>) {
    let p = model.p();
    let (mut sum, mut count) = (vec![0.0; p], vec![0usize; p]);
    let mut course = Course::new(model, gain, x0);
    for (k, (z, u)) in record.outputs.rows().into_iter().zip(record.inputs.rows()).enumerate() {
        let e = course.innovation(z, u);
        for i in 0..p {
            if z[i].is_finite() && k >= SETTLING.min(record.samples() / 4) {
                sum[i] += e[i] * e[i];
                count[i] += 1;
            }
        }
        course.advance();
        if !course.state.iter().all(|x| x.abs() < 1e9) {
            return (vec![f64::INFINITY; p], course.state);
        }
    }
    (sum.iter().zip(&count).map(|(s, &c)| s / (c.max(1)) as f64).collect(), course.state)
}

/// Returns the logarithm of the mean square error over all outputs, which have equal scales; reports call it the
/// overall error.
fn cost(variances: &[f64]) -> f64 {
    variances.iter().sum::<f64>().max(f64::MIN_POSITIVE).ln()
}

/// Descends over the logarithms of the ratio and of the `p` entries of R. Returns the best point and its score, which
/// is infinite if no point has a bounded predictor.
fn descend(p: usize, score: impl Fn(&[f64]) -> f64 + Sync) -> (Vec<f64>, f64) {
    let mut logs = vec![0.0; p + 1];
    let mut best = f64::INFINITY;
    let coarse: Vec<(f64, f64)> = (-8..=4)
        .into_par_iter()
        .map(f64::from)
        .map(|ratio| {
            let mut candidate = logs.clone();
            candidate[0] = ratio;
            (ratio, score(&candidate))
        })
        .collect();
    for (ratio, found) in coarse {
        if found < best {
            (logs[0], best) = (ratio, found);
        }
    }
    if best.is_finite() {
        for step in [0.7, 0.35] {
            for _ in 0..3 {
                let before = best;
                for place in 0..=p {
                    for sign in [1.0, -1.0] {
                        let mut candidate = logs.clone();
                        candidate[place] += sign * step;
                        let found = score(&candidate);
                        if found < best {
                            (logs, best) = (candidate, found);
                            break;
                        }
                    }
                }
                if best > before - 1e-4 {
                    break;
                }
            }
        }
    }
    (logs, best)
}

/// Fits the predictor gain of `model` to `inputs` (samples x m) and `outputs` (samples x p, NaN where a sample is
/// missing), which begin at rest. The last quarter selects among candidates. Returns `None` if no gain keeps the
/// predictor bounded.
pub fn fit_predictor(model: &Model, inputs: ArrayView2<'_, f64>, outputs: ArrayView2<'_, f64>) -> Option<Predictor> {
    let training = Record { inputs, outputs, start: Start::Rest };
    let cut = training.samples() * 3 / 4;
    let learn = training.range(cut.saturating_sub(ENOUGH), cut);
    let decide = training.range(cut, training.samples());
    let rest = model.rest();
    let (n, p) = (model.n(), model.p());

    // Kalman gains for Sigma = ratio I and a diagonal R, by descent over the logarithms of the ratio and the entries of
    // R.
    let gain_of = |logs: &[f64]| -> Option<DMatrix<f64>> {
        let process = DMatrix::identity(n, n) * 10f64.powf(logs[0]);
        let sensor = DMatrix::from_diagonal(&DVector::from_iterator(p, logs[1..].iter().map(|x| 10f64.powf(*x))));
        steady_state_gain(model, &NoiseCovariances::independent(process, sensor)).ok().map(|s| s.gain)
    };
    let score = |logs: &[f64]| -> f64 {
        gain_of(logs).map_or(f64::INFINITY, |gain| cost(&one_step(model, &gain, learn, &rest).0))
    };
    let (logs, best) = descend(p, score);
    let mut candidates: Vec<(DMatrix<f64>, String)> = Vec::new();
    // The open-loop predictor, K = 0, is suitable for a stable model whose outputs are dominated by noise.
    candidates.push((DMatrix::zeros(n, p), "no feedback".into()));
    if let Some(kalman) = best.is_finite().then(|| gain_of(&logs)).flatten() {
        let refined = gauss_newton(model, &kalman, learn, &rest);
        candidates.push((kalman, "steady-state Kalman gain, noise levels fitted to one-step errors".into()));
        candidates.push((refined, "fitted to one-step errors (Gauss-Newton)".into()));
    }
    candidates
        .into_iter()
        .map(|(gain, origin)| {
            let start = one_step(model, &gain, learn, &rest).1;
            let variances = one_step(model, &gain, decide, &start).0;
            (cost(&variances), Predictor { gain, score: variances.iter().map(|v| v.sqrt()).collect(), origin })
        })
        .filter(|(cost, _)| cost.is_finite())
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, predictor)| predictor)
}

/// The fit of K to one-step errors by Gauss-Newton iteration.
struct GainFit<'a, 's> {
    model: &'a Model,
    learn: Record<'s>,
    rest: &'a DVector<f64>,
}

/// A gain and the mean square one-step error of each output with it.
#[derive(Clone)]
struct GainPoint {
    gain: DMatrix<f64>,
    variances: Vec<f64>,
}

/// Rows whose products are added to the normal equations together, per output.
const BLOCK: usize = 64;
/// A step that lowers the logarithm of the mean square error by less than this is the last one.
const SMALL_GAIN: f64 = 1e-4;
const DAMPING: Damping = Damping { start: 1e-3, shrink: 0.2, grow: 10.0, least: 1e-9, tries: 6, factors: &[1.0] };

fn gauss_newton(model: &Model, start: &DMatrix<f64>, learn: Record<'_>, rest: &DVector<f64>) -> DMatrix<f64> {
    let mut fit = GainFit { model, learn, rest };
    let start = fit.at(start.clone());
    let stop = Stop { steps: STEPS, gain: SMALL_GAIN, ..Stop::default() };
    let Ok(found) = minimise(&mut fit, start, DAMPING, stop);
    found.point.gain
}

impl GainFit<'_, '_> {
    fn at(&self, gain: DMatrix<f64>) -> GainPoint {
        let variances = one_step(self.model, &gain, self.learn, self.rest).0;
        GainPoint { gain, variances }
    }
}

impl Problem for GainFit<'_, '_> {
    type Point = GainPoint;
    type Equations = Normal;
    type Error = Infallible;

    fn equations(&self) -> Normal {
        Normal::without_memory(self.model.n() * self.model.p())
    }

    /// The sensitivities of x to K_1j ... K_nj are the columns of Xi_j <- (A - K C) Xi_j + e_{k,j} I, from zero. Xi_j
    /// is a polynomial in A - K C and commutes with it, so C Xi_j <- C Xi_j (A - K C) + e_{k,j} C, which needs p rows
    /// for each of the p columns of K instead of n.
    fn linearise(&mut self, at: &GainPoint, normal: &mut Normal) -> Result<(), Infallible> {
        let Model { a, c, .. } = self.model;
        let (n, p) = (self.model.n(), self.model.p());
        let closed = (a - &at.gain * c).transpose();
        let measured = c.transpose();
        // (C Xi_1)', (C Xi_2)', ... (n x p each).
        let mut sensitivities = DMatrix::<f64>::zeros(n, p * p);
        let mut next = sensitivities.clone();
        let mut block = DMatrix::<f64>::zeros(BLOCK * p, n * p);
        let mut targets = DVector::<f64>::zeros(BLOCK * p);
        let mut filled = 0;
        let mut course = Course::new(self.model, &at.gain, self.rest);
        normal.clear();
        for (z, u) in self.learn.outputs.rows().into_iter().zip(self.learn.inputs.rows()) {
            let e = course.innovation(z, u);
            for i in 0..p {
                let weight = if z[i].is_finite() { 1.0 } else { 0.0 };
                for j in 0..p {
                    let of_output = sensitivities.column(j * p + i);
                    let mut row = block.view_mut((filled, j * n), (1, n));
                    row.iter_mut().zip(of_output.iter()).for_each(|(to, x)| *to = weight * x);
                }
                targets[filled] = e[i];
                filled += 1;
            }
            if filled == BLOCK * p {
                normal.add(block.as_view(), targets.as_view());
                filled = 0;
            }
            next.gemm(1.0, &closed, &sensitivities, 0.0);
            for j in 0..p {
                for i in 0..p {
                    next.column_mut(j * p + i).axpy(e[j], &measured.column(i), 1.0);
                }
            }
            std::mem::swap(&mut sensitivities, &mut next);
            course.advance();
        }
        normal.add(block.rows(0, filled), targets.rows(0, filled));
        Ok(())
    }

    fn advance(&self, from: &GainPoint, step: &DVector<f64>, to: &mut GainPoint) {
        *to = self.at(&from.gain + DMatrix::from_column_slice(self.model.n(), self.model.p(), step.as_slice()));
    }

    fn cost(&self, at: &GainPoint) -> f64 {
        cost(&at.variances)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    /// A plant in innovations form with a known gain and white innovations of standard deviation 0.1 and 0.3.
    #[test]
    fn the_gain_of_an_innovations_form_is_found() {
        let mut model = Model::new(
            1.0,
            DMatrix::from_row_slice(3, 3, &[0.0, -0.7, 0.1, 1.0, 1.2, 0.0, 0.0, 0.2, 0.5]),
            DMatrix::from_column_slice(3, 1, &[1.0, 0.5, -1.0]),
            DMatrix::from_row_slice(2, 3, &[0.0, 1.0, 0.0, 0.0, 0.0, 1.0]),
            DMatrix::zeros(2, 1),
        )
        .unwrap();
        let truth = DMatrix::from_row_slice(3, 2, &[-0.3, 0.1, 0.6, 0.0, 0.1, 0.4]);
        model.predictor_gain = Some(truth.clone());
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let samples = 12_000;
        let (mut inputs, mut outputs) = (Array2::zeros((samples, 1)), Array2::zeros((samples, 2)));
        let mut x = DVector::zeros(3);
        for k in 0..samples {
            let (u, e) = (normal(), DVector::from_column_slice(&[0.1 * normal(), 0.3 * normal()]));
            let y = &model.c * &x + &e;
            inputs[[k, 0]] = u;
            outputs[[k, 0]] = y[0];
            outputs[[k, 1]] = y[1];
            x = &model.a * x + model.b.column(0) * u + &truth * e;
        }
        let found = fit_predictor(&model, inputs.view(), outputs.view()).unwrap();
        // The innovations are the smallest possible error; their RMS over 3000 samples has a relative error of about
        // 1.3 %.
        assert!((found.score[0] / 0.1 - 1.0).abs() < 0.05, "{:?}", found.score);
        assert!((found.score[1] / 0.3 - 1.0).abs() < 0.05, "{:?}", found.score);
        // The weights are equal, so the gain from the quieter output is less certain.
        for i in 0..3 {
            assert!((found.gain[(i, 0)] - truth[(i, 0)]).abs() < 0.15, "{}", found.gain);
            assert!((found.gain[(i, 1)] - truth[(i, 1)]).abs() < 0.05, "{}", found.gain);
        }
    }

    /// The gradient of half the squared one-step errors in [`GainFit`] agrees with finite differences, including the
    /// last samples, which do not fill a block.
    #[test]
    fn the_gradient_agrees_with_finite_differences() {
        let model = Model::new(
            1.0,
            DMatrix::from_row_slice(3, 3, &[0.0, -0.7, 0.1, 1.0, 1.2, 0.0, 0.0, 0.2, 0.5]),
            DMatrix::from_column_slice(3, 1, &[1.0, 0.5, -1.0]),
            DMatrix::from_row_slice(2, 3, &[0.3, 1.0, 0.0, 0.0, -0.2, 1.0]),
            DMatrix::from_column_slice(2, 1, &[0.0, 0.4]),
        )
        .unwrap();
        let gain = DMatrix::from_row_slice(3, 2, &[-0.2, 0.1, 0.4, 0.0, 0.1, 0.3]);
        let samples = BLOCK + 37;
        let inputs = Array2::from_shape_fn((samples, 1), |(k, _)| (0.7 * k as f64).sin());
        let outputs = Array2::from_shape_fn((samples, 2), |(k, i)| (0.3 * (k * (i + 1)) as f64).cos());
        let record = Record { inputs: inputs.view(), outputs: outputs.view(), start: Start::Rest };
        let squares = |gain: &DMatrix<f64>| {
            let mut course = Course::new(&model, gain, &model.rest());
            let rows = outputs.rows().into_iter().zip(inputs.rows());
            let square = |(z, u)| {
                let square = course.innovation(z, u).norm_squared();
                course.advance();
                square
            };
            rows.map(square).sum::<f64>()
        };
        let mut fit = GainFit { model: &model, learn: record, rest: &model.rest() };
        let mut normal = fit.equations();
        fit.linearise(&fit.at(gain.clone()), &mut normal).unwrap();
        for (entry, found) in normal.right.iter().enumerate() {
            let moved = |by: f64| {
                let mut gain = gain.clone();
                gain[entry] += by;
                squares(&gain)
            };
            let expected = -0.5 * (moved(1e-5) - moved(-1e-5)) / 2e-5;
            assert!((found - expected).abs() < 1e-6 * expected.abs().max(1.0), "{entry}: {found} for {expected}");
        }
    }

    #[test]
    fn noise_that_tells_nothing_of_the_state_is_not_fed_back() {
        let model = Model::new(
            1.0,
            DMatrix::from_element(1, 1, 0.9),
            DMatrix::from_element(1, 1, 1.0),
            DMatrix::from_element(1, 1, 1.0),
            DMatrix::zeros(1, 1),
        )
        .unwrap();
        let mut random = ChaCha8Rng::seed_from_u64(6);
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let (mut inputs, mut outputs) = (Array2::zeros((4000, 1)), Array2::zeros((4000, 1)));
        let mut x = 0.0;
        for k in 0..4000 {
            inputs[[k, 0]] = normal();
            outputs[[k, 0]] = x + normal();
            x = 0.9 * x + inputs[[k, 0]];
        }
        let found = fit_predictor(&model, inputs.view(), outputs.view()).unwrap();
        assert!(found.gain[(0, 0)].abs() < 0.05, "{}", found.gain);
        assert!((found.score[0] - 1.0).abs() < 0.05, "{:?}", found.score);
    }
}
