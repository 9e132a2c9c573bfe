//! The gain of the frozen predictor: x_{k+1} = A x_k + B u_k + K e_k with A, B and C held.
//!
//! The noise covariances that make a good *simulation* model are seldom those that make a good one-step predictor, since what
//! the model lacks acts on a prediction as noise. So K is fitted to one-step errors, with A, B and C frozen: first the
//! steady-state Kalman gains over a bank of state noise levels, then Gauss-Newton on K itself.

use nalgebra::{DMatrix, DVector};

use super::Samples;
use crate::model::{Model, NoiseCovariances, steady_state_gain};

/// A frozen predictor's gain.
#[derive(Clone, Debug, PartialEq)]
pub struct Predictor {
    /// K, n x p.
    pub gain: DMatrix<f64>,
    /// RMS of the one-step error on the scoring part of the training data, one an output.
    pub score: Vec<f64>,
    /// How K was found, in words.
    pub origin: String,
}

/// Samples at the start of a record in which the predictor still finds its state.
const SETTLING: usize = 50;
/// Samples that the Gauss-Newton steps use at most; more tell the same.
const ENOUGH: usize = 30_000;
/// Gauss-Newton steps.
const STEPS: usize = 12;

/// Mean square one-step error an output from `x0` on, and the state at the end; infinite if the predictor diverges.
fn one_step(model: &Model, gain: &DMatrix<f64>, samples: Samples<'_>, x0: &DVector<f64>) -> (Vec<f64>, DVector<f64>) {
    let p = model.p();
    let (mut sum, mut count) = (vec![0.0; p], vec![0usize; p]);
    let mut x = x0.clone();
    let mut e = DVector::zeros(p);
    for (k, (z, u)) in samples.outputs.rows().into_iter().zip(samples.inputs.rows()).enumerate() {
        let u = DVector::from_iterator(u.len(), u.iter().copied());
        let y = &model.c * &x + &model.d * &u;
        for i in 0..p {
            e[i] = if z[i].is_finite() { z[i] - y[i] } else { 0.0 };
            if z[i].is_finite() && k >= SETTLING.min(samples.len() / 4) {
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

/// The logarithm of the mean square error over all outputs, which are scaled alike: what reports call the overall error.
fn cost(variances: &[f64]) -> f64 {
    variances.iter().sum::<f64>().max(f64::MIN_POSITIVE).ln()
}

/// Fits the predictor gain of `model` on the training data. The last quarter decides between candidates.
///
/// Returns `None` only if no gain keeps the predictor bounded.
pub fn fit_predictor(model: &Model, training: Samples<'_>) -> Option<Predictor> {
    let cut = training.len() * 3 / 4;
    let learn = training.range(cut.saturating_sub(ENOUGH), cut);
    let decide = training.range(cut, training.len());
    let rest = model.rest();
    let (n, p) = (model.n(), model.p());

    // Kalman gains for Sigma = ratio I and a diagonal R, by descent over the logarithms of ratio and R's entries.
    let gain_of = |logs: &[f64]| -> Option<DMatrix<f64>> {
        let process = DMatrix::identity(n, n) * 10f64.powf(logs[0]);
        let sensor = DMatrix::from_diagonal(&DVector::from_iterator(p, logs[1..].iter().map(|x| 10f64.powf(*x))));
        steady_state_gain(model, &NoiseCovariances::independent(process, sensor)).ok().map(|s| s.gain)
    };
    let score = |logs: &[f64]| -> f64 {
        gain_of(logs).map_or(f64::INFINITY, |gain| cost(&one_step(model, &gain, learn, &rest).0))
    };
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
    let mut candidates: Vec<(DMatrix<f64>, String)> = Vec::new();
    // The open-loop predictor, K = 0, serves a stable model of an output that is all noise.
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

/// Gauss-Newton on K: the sensitivity of x to K_ij obeys xi_{k+1} = (A - K C) xi_k + e_i e_{k,j}. For one j all of them are
/// one n x n matrix Xi_j driven by the scalar e_j: Xi_j <- (A - K C) Xi_j + e_{k,j} I.
fn gauss_newton(model: &Model, start: &DMatrix<f64>, learn: Samples<'_>, rest: &DVector<f64>) -> DMatrix<f64> {
    let (n, p) = (model.n(), model.p());
    let mut gain = start.clone();
    let mut variances = one_step(model, &gain, learn, rest).0;
    let mut damping = 1e-3;
    for _ in 0..STEPS {
        let closed = &model.a - &gain * &model.c;
        let size = n * p;
        let (mut normal, mut right) = (DMatrix::<f64>::zeros(size, size), DVector::<f64>::zeros(size));
        let mut sensitivities = vec![DMatrix::<f64>::zeros(n, n); p];
        let mut x = rest.clone();
        let mut e = DVector::zeros(p);
        let mut rows = DMatrix::<f64>::zeros(p, size);
        // Normal equations gather in blocks: one product of many rows is far faster than many rank-one updates.
        const BLOCK: usize = 64;
        let mut block = DMatrix::<f64>::zeros(BLOCK * p, size);
        let mut targets = DVector::<f64>::zeros(BLOCK * p);
        let mut filled = 0;
        for (z, u) in learn.outputs.rows().into_iter().zip(learn.inputs.rows()) {
            let u = DVector::from_iterator(u.len(), u.iter().copied());
            let y = &model.c * &x + &model.d * &u;
            for j in 0..p {
                e[j] = if z[j].is_finite() { z[j] - y[j] } else { 0.0 };
                rows.view_mut((0, j * n), (p, n)).copy_from(&(&model.c * &sensitivities[j]));
            }
            for i in 0..p {
                let weight = if z[i].is_finite() { 1.0 } else { 0.0 };
                block.row_mut(filled).copy_from(&(rows.row(i) * weight));
                targets[filled] = e[i] * weight;
                filled += 1;
            }
            if filled == BLOCK * p {
                normal.gemm_tr(1.0, &block, &block, 1.0);
                right.gemv_tr(1.0, &block, &targets, 1.0);
                filled = 0;
            }
            for (j, xi) in sensitivities.iter_mut().enumerate() {
                *xi = &closed * &*xi;
                for i in 0..n {
                    xi[(i, i)] += e[j];
                }
            }
            x = &model.a * x + &model.b * u + &gain * &e;
        }
        let mut improved = false;
        for _ in 0..6 {
            let mut damped = normal.clone();
            for i in 0..size {
                damped[(i, i)] += damping * (normal[(i, i)] + f64::MIN_POSITIVE);
            }
            let Some(step) = damped.cholesky().map(|factor| factor.solve(&right)) else {
                damping *= 10.0;
                continue;
            };
            let candidate = &gain + DMatrix::from_column_slice(n, p, step.as_slice());
            let found = one_step(model, &candidate, learn, rest).0;
            if cost(&found) < cost(&variances) {
                improved = cost(&found) < cost(&variances) - 1e-4;
                (gain, variances) = (candidate, found);
                damping = (damping / 5.0).max(1e-9);
                break;
            }
            damping *= 10.0;
        }
        if !improved {
            break;
        }
    }
    gain
}
