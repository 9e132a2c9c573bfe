//! The covariance of the refined parameters, and the uncertainties derived from it.
//!
//! If the errors are white and independent with the estimated variances, J'WJ is the Fisher information of the
//! parameters. Its inverse is the covariance, the Cramer-Rao bound, which the estimate attains for long records. The
//! states of a section may be rescaled without any change of the response, so J'WJ is singular in these directions and
//! its pseudo-inverse is used. Responses and poles do not depend on these directions, so their variance is the same as
//! in any other coordinates.
//!
//! If the simulation error is not white because of model error, the actual scatter is larger: the stated uncertainty
//! accounts for noise alone.

use std::f64::consts::TAU;

use faer::{Mat, Side};
use nalgebra::{Complex, DMatrix, DVector};
use plid_model::{ModeDeviation, Model, ModelError, ResponseVariance, modes};

use crate::error::RefineError;
use crate::normal::Order;
use crate::sections::Sections;

/// Directions with less information than this, relative to the largest, are not determined by the data.
const TOLD: f64 = 1e-12;

/// Covariance of the parameters of a refined model.
#[derive(Clone, Debug)]
pub struct Uncertainty {
    model: Sections,
    covariance: DMatrix<f64>,
    /// The map from the fitted outputs, which may be scaled and mixed, to the records' outputs (p x p).
    outputs: DMatrix<f64>,
    /// The divisors of the inputs (m).
    inputs: Vec<f64>,
    sample_rate_hz: f64,
}

impl Uncertainty {
    pub(crate) fn new(
        model: &Sections,
        information: &DMatrix<f64>,
        outputs: &DMatrix<f64>,
        inputs: &[f64],
        sample_rate_hz: f64,
    ) -> Result<Self, RefineError> {
        Ok(Self {
            model: model.clone(),
            covariance: pseudo_inverse(information)?,
            outputs: outputs.clone(),
            inputs: inputs.to_vec(),
            sample_rate_hz,
        })
    }

    /// Returns the response at each frequency in Hz with its first-order variances, in the records' units. H of the
    /// pair (i, j) depends on the poles, column j of B, row i of C, and D_ij.
    ///
    /// # Errors
    /// Returns [`ModelError::Frequency`] for a frequency outside 0 to half the sample rate.
    pub fn response_variance(&self, hz: &[f64]) -> Result<Vec<ResponseVariance>, ModelError> {
        let nyquist = self.sample_rate_hz / 2.0;
        if let Some(&hz) = hz.iter().find(|f| !(**f >= 0.0 && **f <= nyquist)) {
            return Err(ModelError::Frequency { hz, nyquist });
        }
        Ok(hz.iter().map(|hz| self.at(Complex::cis(TAU * hz / self.sample_rate_hz))).collect())
    }

    fn at(&self, z: Complex<f64>) -> ResponseVariance {
        let (p, m) = (self.model.p(), self.model.m());
        let mut result = ResponseVariance {
            response: DMatrix::zeros(p, m),
            real: DMatrix::zeros(p, m),
            imaginary: DMatrix::zeros(p, m),
            cross: DMatrix::zeros(p, m),
        };
        for j in 0..m {
            let fitted: Vec<_> = (0..p).map(|l| self.gradient(l, j, z)).collect();
            for i in 0..p {
                let mut response = Complex::ZERO;
                let mut gradient = vec![Complex::ZERO; self.covariance.nrows()];
                for (l, (own, slopes)) in fitted.iter().enumerate().filter(|(l, _)| self.outputs[(i, *l)] != 0.0) {
                    let weight = self.outputs[(i, l)] / self.inputs[j];
                    response += own * weight;
                    slopes.iter().for_each(|&(parameter, slope)| gradient[parameter] += slope * weight);
                }
                let moved: Vec<(usize, Complex<f64>)> =
                    gradient.into_iter().enumerate().filter(|(_, g)| *g != Complex::ZERO).collect();
                let (mut real, mut imaginary, mut cross) = (0.0_f64, 0.0_f64, 0.0_f64);
                for &(a, ga) in &moved {
                    let column = self.covariance.column(a);
                    let along = moved.iter().fold(Complex::<f64>::ZERO, |sum, &(b, gb)| sum + gb * column[b]);
                    real += ga.re * along.re;
                    imaginary += ga.im * along.im;
                    cross += ga.re * along.im;
                }
                let at = (i, j);
                result.response[at] = response;
                result.real[at] = real.max(0.0);
                result.imaginary[at] = imaginary.max(0.0);
                result.cross[at] = cross;
            }
        }
        result
    }

    /// Returns H_ij at z and its derivative with respect to each parameter that affects it, in scaled channels.
    fn gradient(&self, i: usize, j: usize, z: Complex<f64>) -> (Complex<f64>, Vec<(usize, Complex<f64>)>) {
        let model = &self.model;
        let order = Order::of(model);
        let mut response = Complex::from(model.d[(i, j)]);
        let mut gradient = Vec::with_capacity(3 * model.states + 1);
        for (s, section) in model.poles.iter().enumerate() {
            let (at, up, down) = (2 * s, section.up, section.down());
            let v = z - section.c;
            let q = v * v - section.d;
            let resolvent = |x: [Complex<f64>; 2]| [(v * x[0] + x[1] * up) / q, (x[0] * down + v * x[1]) / q];
            let dual = |x: [f64; 2]| [(v * x[0] + x[1] * down) / q, (v * x[1] + x[0] * up) / q];
            let c = [model.c[(i, at)], model.c[(i, at + 1)]];
            let state = resolvent([model.b[(at, j)], model.b[(at + 1, j)]].map(Complex::from));
            let row = dual(c);
            response += state[0] * c[0] + state[1] * c[1];
            // The derivatives of A are dA/dc = I and dA/dd = e2 e1' / up.
            let of_c = row[0] * state[0] + row[1] * state[1];
            let of_d = if section.is_pair() { row[1] * state[0] / up } else { Complex::ZERO };
            let slope = section.slope(model.radius);
            for coordinate in 0..model.order(s) {
                let value = of_c * slope[0][coordinate] + of_d * slope[1][coordinate];
                gradient.push((order.pole(s, coordinate), value));
            }
            for k in 0..model.order(s) {
                gradient.push((order.b(at + k, j), row[k]));
                gradient.push((order.c(i, at + k), state[k]));
            }
        }
        if model.feedthrough {
            gradient.push((order.d(i, j), Complex::from(1.0)));
        }
        (response, gradient)
    }

    /// Returns the modes of `model`, which must be the refined one, with first-order standard deviations of frequency
    /// and damping. They are `None` where two poles nearly coincide, because the first-order expansion does not exist
    /// there.
    ///
    /// # Errors
    /// Returns [`ModelError::Eigenvalues`] if the eigenvalue iteration does not converge.
    pub fn mode_deviations(&self, model: &Model) -> Result<Vec<ModeDeviation>, ModelError> {
        let deviations = modes(model)?.into_iter().map(|mode| {
            let both = self.of_pole(mode.pole);
            ModeDeviation { hz_std: both.map(|x| x.0), damping_std: both.map(|x| x.1), mode }
        });
        Ok(deviations.collect())
    }

    fn of_pole(&self, pole: Complex<f64>) -> Option<(f64, f64)> {
        let distance = |s: usize, z: &Complex<f64>| (s, *z, (z - pole).norm());
        let all = self.model.poles.iter().enumerate();
        let (s, own, off) = all
            .flat_map(|(s, section)| section.poles().into_iter().map(move |z| (s, z)))
            .map(|(s, z)| distance(s, &z))
            .min_by(|a, b| a.2.total_cmp(&b.2))?;
        let section = &self.model.poles[s];
        // Where the two poles of a section nearly coincide, the derivative of the square root diverges.
        let parted = !section.is_pair() || section.d.abs() > 1e-12;
        if off > 1e-6 || !parted || own == Complex::ZERO {
            return None;
        }
        let root = own - section.c;
        let slope = section.slope(self.model.radius);
        let size = self.model.order(s);
        let rate = self.sample_rate_hz;
        let continuous = own.ln() * rate;
        let natural = continuous.norm();
        if !(natural > 0.0) {
            return None;
        }
        let of = |coordinate: usize| {
            let of_d = if section.is_pair() { slope[1][coordinate] / (root * 2.0) } else { Complex::ZERO };
            let ds = (of_d + slope[0][coordinate]) * rate / own;
            let along = (continuous.conj() * ds).re / natural;
            (along, -ds.re / natural + continuous.re * along / (natural * natural))
        };
        let slopes: Vec<(f64, f64)> = (0..size).map(of).collect();
        let order = Order::of(&self.model);
        let std = |pick: &dyn Fn(&(f64, f64)) -> f64| {
            let mut sum = 0.0;
            for a in 0..size {
                for b in 0..size {
                    sum += pick(&slopes[a]) * pick(&slopes[b]) * self.covariance[(order.pole(s, a), order.pole(s, b))];
                }
            }
            sum.max(0.0).sqrt()
        };
        let positive_real = own.im == 0.0 && own.re > 0.0;
        let damping = if positive_real { 0.0 } else { std(&|x| x.1) };
        Some((std(&|x| x.0) / TAU, damping))
    }
}

/// Returns the pseudo-inverse of a positive semidefinite matrix, computed after scaling it to a unit diagonal.
fn pseudo_inverse(information: &DMatrix<f64>) -> Result<DMatrix<f64>, RefineError> {
    let size = information.nrows();
    let scale: DVector<f64> = information.diagonal().map(|x| if x > 0.0 { 1.0 / x.sqrt() } else { 0.0 });
    let scaled = Mat::from_fn(size, size, |i, j| information[(i, j)] * scale[i] * scale[j]);
    let found = scaled
        .self_adjoint_eigen(Side::Lower)
        .map_err(|_| RefineError::Decomposition { what: "the eigenvalue decomposition of the information" })?;
    let values: Vec<f64> = found.S().column_vector().iter().copied().collect();
    let largest = values.iter().copied().fold(0.0, f64::max);
    let told: Vec<usize> = (0..size).filter(|&k| values[k] > TOLD * largest).collect();
    // The columns are those of a square root of the covariance.
    let root = DMatrix::from_fn(size, told.len(), |i, k| found.U()[(i, told[k])] / values[told[k]].sqrt() * scale[i]);
    Ok(&root * root.transpose())
}
