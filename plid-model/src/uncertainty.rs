use std::f64::consts::TAU;
use std::ops::Range;

use nalgebra::{Complex, DMatrix, DVector};

use super::error::ModelError;
use super::frequency_response::{FrequencyResponse, expect_frequencies, on_circle};
use super::hessenberg::HessenbergModel;
use super::modes::{Mode, ModeKind, modes};
use super::state_space::Model;

/// Tolerance on the fixed entries of a canonical A, relative to its largest entry.
const CANONICAL: f64 = 1e-9;

/// First-order variances and covariances of the frequency response at one frequency (each p x m).
#[derive(Debug, Clone, PartialEq)]
pub struct ResponseVariance {
    /// The response H, in output units per input unit.
    pub response: DMatrix<Complex<f64>>,
    /// Variance of Re H.
    pub real: DMatrix<f64>,
    /// Variance of Im H.
    pub imaginary: DMatrix<f64>,
    /// Covariance of Re H and Im H.
    pub cross: DMatrix<f64>,
}

impl ResponseVariance {
    /// Returns the standard deviation of |H| (p x m), that is, of the component along H; where H is zero, sqrt(var Re +
    /// var Im).
    pub fn magnitude_std(&self) -> DMatrix<f64> {
        DMatrix::from_fn(self.response.nrows(), self.response.ncols(), |i, j| {
            let at = (i, j);
            let (re, im, cross) = (self.real[at], self.imaginary[at], self.cross[at]);
            let size = self.response[at].norm();
            if size == 0.0 {
                return (re + im).max(0.0).sqrt();
            }
            let (c, s) = (self.response[at].re / size, self.response[at].im / size);
            (c * c * re + s * s * im + 2.0 * c * s * cross).max(0.0).sqrt()
        })
    }
}

/// Computes the variance of the response at each frequency from the parameter covariance by the delta method, for A and
/// C in observable canonical form. With W = C (z I - A)^{-1} the gradients are `dH_lj / da_i[k] = W_lk H_ij` and `dH_lj
/// / db_j[k] = z^advance W_lk`.
///
/// `advance` is 1 for a model from [`super::undo_advance`], whose B and D are A b and C b and whose response is z times
/// that of (A, b, C); otherwise it is 0.
///
/// # Errors
/// Returns [`ModelError::Needs`] without indices or covariance, [`ModelError::NotCanonical`] or
/// [`ModelError::Frequency`].
pub fn response_variance(model: &Model, hz: &[f64], advance: u32) -> Result<Vec<ResponseVariance>, ModelError> {
    let covariance = canonical_covariance(model)?;
    expect_frequencies(model, hz)?;
    let reduced = HessenbergModel::of(model);
    let response = FrequencyResponse::of(model);
    let variance = |&hz: &f64| {
        let z = on_circle(hz, model.sample_rate_hz);
        let rows = reduced.resolvent_rows(z);
        at_frequency(covariance, &rows, response.at(hz), z.powu(advance))
    };
    Ok(hz.iter().map(variance).collect())
}

fn at_frequency(
    covariance: &DMatrix<f64>,
    rows: &DMatrix<Complex<f64>>,
    response: DMatrix<Complex<f64>>,
    shift: Complex<f64>,
) -> ResponseVariance {
    let (p, m) = response.shape();
    let mut real = DMatrix::zeros(p, m);
    let (mut imaginary, mut cross) = (real.clone(), real.clone());
    for l in 0..p {
        let blocks = Blocks::of(covariance, rows, l);
        for j in 0..m {
            // The gradient is weights (x) W_l, with one weight for each parameter vector that affects the pair.
            let weights: Vec<(usize, Complex<f64>)> =
                (0..p).map(|i| (i, response[(i, j)])).chain([(p + j, shift)]).collect();
            let (mut hermitian, mut plain) = (0.0, Complex::<f64>::ZERO);
            for &(s, ws) in &weights {
                for &(t, wt) in &weights {
                    hermitian += (ws * blocks.hermitian[(s, t)] * wt.conj()).re;
                    plain += ws * blocks.plain[(s, t)] * wt;
                }
            }
            real[(l, j)] = (hermitian + plain.re) / 2.0;
            imaginary[(l, j)] = (hermitian - plain.re) / 2.0;
            cross[(l, j)] = plain.im / 2.0;
        }
    }
    ResponseVariance { response, real, imaginary, cross }
}

/// The products W_l P_st W_l^H and W_l P_st W_l^T for every pair of parameter vectors s and t.
struct Blocks {
    hermitian: DMatrix<Complex<f64>>,
    plain: DMatrix<Complex<f64>>,
}

impl Blocks {
    fn of(covariance: &DMatrix<f64>, rows: &DMatrix<Complex<f64>>, l: usize) -> Self {
        let n = rows.ncols();
        let count = covariance.nrows() / n;
        let parts = DMatrix::from_fn(n, 2, |k, part| {
            let w = rows[(l, k)];
            if part == 0 { w.re } else { w.im }
        });
        let mut hermitian = DMatrix::zeros(count, count);
        let mut plain = hermitian.clone();
        for t in 0..count {
            let moved = covariance.columns(t * n, n) * &parts;
            for s in 0..count {
                let four = parts.transpose() * moved.rows(s * n, n);
                let (rr, ri, ir, ii) = (four[(0, 0)], four[(0, 1)], four[(1, 0)], four[(1, 1)]);
                hermitian[(s, t)] = Complex::new(rr + ii, ir - ri);
                plain[(s, t)] = Complex::new(rr - ii, ir + ri);
            }
        }
        Self { hermitian, plain }
    }
}

/// A mode with the standard deviations of its frequency and damping ratio.
#[derive(Debug, Clone, PartialEq)]
pub struct ModeDeviation {
    /// The mode.
    pub mode: Mode,
    /// Standard deviation of the natural frequency in Hz; `None` where the first-order approximation does not exist.
    pub hz_std: Option<f64>,
    /// Standard deviation of the damping ratio; zero for a positive real pole, whose ratio is always +1 or -1.
    pub damping_std: Option<f64>,
}

/// Returns the modes with first-order standard deviations from the parameter covariance, for A and C in observable
/// canonical form: with l . r = 1, `dlambda / da_i[k] = l_k (C r)_i`. The deviations are `None` for repeated poles and
/// for poles at zero and one, which have no first-order expansion.
///
/// # Errors
/// Returns [`ModelError::Needs`] without indices or covariance, [`ModelError::NotCanonical`] or
/// [`ModelError::Eigenvalues`].
pub fn mode_deviations(model: &Model) -> Result<Vec<ModeDeviation>, ModelError> {
    let covariance = canonical_covariance(model)?;
    let deviations = modes(model)?.into_iter().map(|mode| {
        let both = mode_std(model, covariance, &mode);
        ModeDeviation { hz_std: both.map(|x| x.0), damping_std: both.map(|x| x.1), mode }
    });
    Ok(deviations.collect())
}

fn mode_std(model: &Model, covariance: &DMatrix<f64>, mode: &Mode) -> Option<(f64, f64)> {
    let left = mode.left.as_ref()?;
    let rate = model.sample_rate_hz;
    let s = mode.continuous(rate);
    let size = s.norm();
    if !(size.is_finite() && size > 0.0) {
        return None;
    }
    let outputs = model.c.map(Complex::from) * &mode.right;
    let (n, count) = (model.n(), model.n() * model.p());
    let ds = DVector::from_fn(count, |t, _| left[t % n] * outputs[t / n] * rate / mode.pole);
    let along = ds.map(|ds| (s.conj() * ds).re / size);
    let damping = ds.zip_map(&along, |ds, along| -ds.re / size + s.re * along / (size * size));
    let of_a = covariance.view((0, 0), (count, count));
    let std = |g: &DVector<f64>| g.dot(&(of_a * g)).max(0.0).sqrt();
    // The damping ratio of a positive real pole is +1 or -1 whatever its size. A negative real pole has phase pi, so
    // its ratio varies.
    let positive_real = mode.kind == ModeKind::Real && mode.pole.re > 0.0;
    let damping_std = if positive_real { 0.0 } else { std(&damping) };
    Some((std(&along) / TAU, damping_std))
}

/// Returns the range of states of each output's block.
fn blocks(indices: &[usize]) -> Vec<Range<usize>> {
    let mut start = 0;
    let block = indices.iter().map(|size| {
        let block = start..start + size;
        start = block.end;
        block
    });
    block.collect()
}

/// Returns the parameter covariance of a model in observable canonical form.
fn canonical_covariance(model: &Model) -> Result<&DMatrix<f64>, ModelError> {
    let purpose = "computing its uncertainty";
    let need = |key| ModelError::Needs { key, purpose };
    let indices = model.observability_indices.as_deref();
    let indices = indices.ok_or(need("observability_indices"))?;
    let covariance = model.parameter_covariance.as_ref();
    let covariance = covariance.ok_or(need("parameter_covariance"))?;
    let tolerance = CANONICAL * model.a.amax();
    for (i, block) in blocks(indices).into_iter().enumerate() {
        for k in block.clone() {
            let last = k + 1 == block.end;
            for row in 0..model.n() {
                let shift = if row == k + 1 { 1.0 } else { 0.0 };
                if !last && (model.a[(row, k)] - shift).abs() > tolerance {
                    return Err(ModelError::NotCanonical { key: "A" });
                }
            }
            for output in 0..model.p() {
                let pick = if last && output == i { 1.0 } else { 0.0 };
                if (model.c[(output, k)] - pick).abs() > CANONICAL {
                    return Err(ModelError::NotCanonical { key: "C" });
                }
            }
        }
    }
    Ok(covariance)
}

#[cfg(test)]
mod tests {
    use super::super::advance::undo_advance;
    use super::super::frequency_response::frequency_response;
    use super::super::testing::{canonical, covariance, numbers, two_modes};
    use super::*;
    use approx::assert_relative_eq;

    fn uncertain(seed: u64, indices: &[usize], m: usize, scale: f64) -> Model {
        let mut model = canonical(seed, indices, m);
        let size = (model.p() + m) * model.n();
        model.parameter_covariance = Some(covariance(seed + 50, size) * scale);
        model
    }

    /// Returns the model with the parameters theta changed by `step`.
    fn moved(model: &Model, step: &DVector<f64>) -> Model {
        let (n, p) = (model.n(), model.p());
        let ends = blocks(model.observability_indices.as_ref().unwrap());
        let mut other = model.clone();
        for (t, x) in step.iter().enumerate() {
            let (vector, k) = (t / n, t % n);
            if vector < p {
                other.a[(k, ends[vector].end - 1)] += x;
            } else {
                other.b[(k, vector - p)] += x;
            }
        }
        other
    }

    /// Returns the gradient of a scalar property of the model with respect to theta, by central differences.
    fn gradient(model: &Model, figure: impl Fn(&Model) -> f64) -> DVector<f64> {
        let size = model.parameter_covariance.as_ref().unwrap().nrows();
        DVector::from_fn(size, |t, _| {
            let mut step = DVector::zeros(size);
            step[t] = 1e-5;
            (figure(&moved(model, &step)) - figure(&moved(model, &-step))) / 2e-5
        })
    }

    fn std(model: &Model, gradient: &DVector<f64>) -> f64 {
        let covariance = model.parameter_covariance.as_ref().unwrap();
        gradient.dot(&(covariance * gradient)).sqrt()
    }

    #[test]
    fn the_response_agrees_with_differences() {
        let model = uncertain(3, &[3, 2], 2, 1e-6);
        for advance in [0, 1] {
            let as_used = |model: &Model| {
                if advance == 1 { undo_advance(model, None).unwrap() } else { model.clone() }
            };
            let found = &response_variance(&as_used(&model), &[13.0], advance).unwrap()[0];
            for (l, j) in [(0, 0), (1, 0), (0, 1)] {
                let h = |model: &Model| frequency_response(&as_used(model), &[13.0]).unwrap()[0][(l, j)];
                let magnitude = gradient(&model, |x| h(x).norm());
                let (re, im) = (gradient(&model, |x| h(x).re), gradient(&model, |x| h(x).im));
                let cross = re.dot(&(model.parameter_covariance.as_ref().unwrap() * &im));
                let at = (l, j);
                let (tight, wide) = (1e-6, 1e-5);
                assert_relative_eq!(found.magnitude_std()[at], std(&model, &magnitude), max_relative = tight);
                assert_relative_eq!(found.real[at].sqrt(), std(&model, &re), max_relative = tight);
                assert_relative_eq!(found.imaginary[at].sqrt(), std(&model, &im), max_relative = tight);
                assert_relative_eq!(found.cross[at], cross, max_relative = wide, epsilon = 1e-13);
            }
        }
    }

    #[test]
    fn modes_agree_with_differences() {
        let model = uncertain(7, &[3, 2], 1, 1e-6);
        let found = mode_deviations(&model).unwrap();
        assert!(found.iter().any(|x| x.mode.kind == ModeKind::Oscillatory));
        for (index, deviation) in found.iter().enumerate() {
            let hz = gradient(&model, |x| modes(x).unwrap()[index].hz);
            let damping = gradient(&model, |x| modes(x).unwrap()[index].damping);
            let (a, b) = (deviation.hz_std.unwrap(), deviation.damping_std.unwrap());
            assert_relative_eq!(a, std(&model, &hz), max_relative = 1e-5);
            assert_relative_eq!(b, std(&model, &damping), max_relative = 1e-5, epsilon = 1e-9);
        }
    }

    #[test]
    fn both_agree_with_random_draws() {
        let model = uncertain(11, &[2, 2], 1, 1e-7);
        let root = model.parameter_covariance.clone().unwrap().cholesky().unwrap().l();
        let response = response_variance(&model, &[9.0], 0).unwrap()[0].magnitude_std();
        let mode = &mode_deviations(&model).unwrap()[0];
        let mut next = numbers(1);
        // A sum of 12 uniform numbers is close enough to Gaussian for a second moment.
        let mut gaussian = || (0..12).map(|_| next()).sum::<f64>() / 2.0;
        let draws = 4000;
        let (mut size, mut hz) = (Vec::new(), Vec::new());
        for _ in 0..draws {
            let step = &root * DVector::from_fn(root.nrows(), |_, _| gaussian());
            let other = moved(&model, &step);
            size.push(frequency_response(&other, &[9.0]).unwrap()[0][(1, 0)].norm());
            hz.push(modes(&other).unwrap()[0].hz);
        }
        let spread = |x: Vec<f64>| DVector::from_vec(x).variance().sqrt();
        // A standard deviation from 4000 draws has a relative error of 1.1 %; the tolerance is four times that.
        assert_relative_eq!(spread(size), response[(1, 0)], max_relative = 0.045);
        assert_relative_eq!(spread(hz), mode.hz_std.unwrap(), max_relative = 0.045);
    }

    #[test]
    fn without_canonical_form_there_is_no_answer() {
        let mut model = uncertain(3, &[3, 2], 2, 1e-6);
        model.a[(0, 0)] = 0.1;
        let error = mode_deviations(&model);
        assert!(matches!(error, Err(ModelError::NotCanonical { key: "A" })));
        let error = response_variance(&two_modes(), &[1.0], 0);
        assert!(matches!(error, Err(ModelError::Needs { key: "observability_indices", .. })));
    }
}
