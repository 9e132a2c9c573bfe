//! The gain of the steady-state predictor x_{k+1} = A x_k + B u_k + K e_k with fixed A, B and C.
//!
//! The noise covariances that give a good simulation model are seldom those that give a good one-step predictor,
//! because model error acts on a prediction like noise. K is therefore fitted to one-step errors: first as the
//! steady-state Kalman gain over a set of state noise levels, then by Gauss-Newton iteration on K itself.

use std::convert::Infallible;

use nalgebra::{DMatrix, DVector};
use ndarray::ArrayView2;
use plid_lsq::{Damping, Normal, Problem, Stop, minimise};

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

/// Returns the mean square one-step error of each output from `x0` on, and the final state; infinite if the predictor
/// diverges.
fn one_step(model: &Model, gain: &DMatrix<f64>, record: Record<'_>, x0: &DVector<f64>) -> (Vec<f64>, DVector<f64>) {
    let p = model.p();
    let (mut sum, mut count) = (vec![0.0; p], vec![0usize; p]);
    let mut x = x0.clone();
    let mut e = DVector::zeros(p);
    for (k, (z, u)) in record.outputs.rows().into_iter().zip(record.inputs.rows()).enumerate() {
        let u = DVector::from_iterator(u.len(), u.iter().copied());
        let y = &model.c * &x + &model.d * &u;
        for i in 0..p {
            e[i] = if z[i].is_finite() { z[i] - y[i] } else { 0.0 };
            if z[i].is_finite() && k >= SETTLING.min(record.samples() / 4) {
                sum[i] += e[i] * e[i];
                count[i] += 1;
            }
        }
        x = &model.a * x + &model.b * u + gain * &e;
        if !x.iter().all(|x| x.abs() < 1e9) {
            return (vec![f64::INFINITY; p], x);
        }
    }
    (sum.iter().zip(&count).map(|(s, &c)| s / (c.max(1)) as f64).collect(), x)
}

/// Returns the logarithm of the mean square error over all outputs, which have equal scales; reports call it the
/// overall error.
fn cost(variances: &[f64]) -> f64 {
    variances.iter().sum::<f64>().max(f64::MIN_POSITIVE).ln()
}

/// Descends over the logarithms of the ratio and of the `p` entries of R. Returns the best point and its score, which
/// is infinite if no point has a bounded predictor.
fn descend(p: usize, score: impl Fn(&[f64]) -> f64) -> (Vec<f64>, f64) {
    let mut logs = vec![0.0; p + 1];
    let mut best = f64::INFINITY;
    for ratio in -8..=4 {
        let mut candidate = logs.clone();
        candidate[0] = f64::from(ratio);
        let found = score(&candidate);
        if found < best {
            (logs, best) = (candidate, found);
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

/// The fit of K to one-step errors, with a Gauss-Newton matrix.
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

    /// The sensitivity of x to K_ij obeys xi_{k+1} = (A - K C) xi_k + e_i e_{k,j}; for fixed j these form an n x n
    /// matrix Xi_j driven by the scalar e_j: Xi_j <- (A - K C) Xi_j + e_{k,j} I.
    fn linearise(&mut self, at: &GainPoint, normal: &mut Normal) -> Result<(), Infallible> {
        let Model { a, b, c, d, .. } = self.model;
        let (n, p) = (self.model.n(), self.model.p());
        let closed = a - &at.gain * c;
        let mut sensitivities = vec![DMatrix::<f64>::zeros(n, n); p];
        let mut x = self.rest.clone();
        let mut e = DVector::zeros(p);
        let mut rows = DMatrix::<f64>::zeros(p, n * p);
        let mut block = DMatrix::<f64>::zeros(BLOCK * p, n * p);
        let mut targets = DVector::<f64>::zeros(BLOCK * p);
        let mut filled = 0;
        normal.clear();
        for (z, u) in self.learn.outputs.rows().into_iter().zip(self.learn.inputs.rows()) {
            let u = DVector::from_iterator(u.len(), u.iter().copied());
            let y = c * &x + d * &u;
            for j in 0..p {
                e[j] = if z[j].is_finite() { z[j] - y[j] } else { 0.0 };
                rows.view_mut((0, j * n), (p, n)).copy_from(&(c * &sensitivities[j]));
            }
            for i in 0..p {
                let weight = if z[i].is_finite() { 1.0 } else { 0.0 };
                block.row_mut(filled).copy_from(&(rows.row(i) * weight));
                targets[filled] = e[i] * weight;
                filled += 1;
            }
            if filled == BLOCK * p {
                normal.add(block.as_view(), targets.as_view());
                filled = 0;
            }
            for (j, xi) in sensitivities.iter_mut().enumerate() {
                *xi = &closed * &*xi;
                (0..n).for_each(|i| xi[(i, i)] += e[j]);
            }
            x = a * x + b * u + &at.gain * &e;
        }
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
        // The weights are equal, so the gain from the noisier output is less certain.
        for i in 0..3 {
            assert!((found.gain[(i, 0)] - truth[(i, 0)]).abs() < 0.15, "{}", found.gain);
            assert!((found.gain[(i, 1)] - truth[(i, 1)]).abs() < 0.05, "{}", found.gain);
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
