//! The noise of a record without repetition, estimated by the local polynomial method (Pintelon, Schoukens,
//! Vandersteen and Barbé, *Mechanical Systems and Signal Processing* 24, 2010, 573).
//!
//! Over a few neighbouring frequencies, the response of any linear plant, and the transient of a record that begins
//! and ends in different states, are smooth: Y(k + r) = G(r) U(k + r) + T(r) + E(k + r), with polynomials G and T.
//! The residual at k consists of the noise and of the random-like distortion of a nonlinear plant, so its level is at
//! least that of the noise. The error of the simulation takes the place of Y. Its response is smaller than that of
//! the plant, and so is the part of a narrow resonance that the polynomials miss.

use std::iter::{once, repeat_n};

use nalgebra::DVector;

use super::Stretch;
use crate::case::record::Record;
use plid_fourier::C;

/// Degree of the polynomials.
const DEGREE: usize = 2;

/// Number of equations that remain for the noise at each frequency, for each output.
const FREE: usize = 4;

/// Largest number of samples that are used of a record. Each frequency requires its own basis, and half as many
/// frequencies determine the level to two per cent.
const MOST_SAMPLES: usize = 8192;

/// Smallest share of the squared norm of a regressor that the other regressors must leave for it to count.
const DEPENDENT: f64 = 1e-10;

/// Returns the part of the error of a simulation (p channels) that the inputs of a driven record do not explain, as a
/// stretch that no command explains; `None` if samples are missing or the record is too short.
pub(crate) fn unexplained(record: &Record, error: &[Vec<f64>]) -> Option<Stretch> {
    if record.y.iter().flatten().any(|y| y.is_nan()) {
        return None;
    }
    let part = |channels: &[Vec<f64>]| -> Vec<Vec<f64>> {
        channels.iter().map(|x| x[..x.len().min(MOST_SAMPLES)].to_vec()).collect()
    };
    let (inputs, outputs) = (Stretch::new(&part(&record.u)), Stretch::new(&part(error)));
    let unknowns = (DEGREE + 1) * (record.u.len() + 1);
    let reach = (unknowns + FREE * record.y.len()).div_ceil(2);
    let count = outputs.bins[0].len();
    if count <= 4 * reach {
        return None;
    }
    let weights: Vec<Weights> = (0..count).map(|k| Weights::new(&inputs.bins, k, reach)).collect();
    let residual = |y: &Vec<C>| weights.iter().map(|weights| weights.applied(y)).collect();
    let bins = outputs.bins.iter().map(residual).collect();
    Some(Stretch { length: outputs.length, bins, freedom: freedom(&weights) })
}

/// The residual at a frequency as a sum over neighbouring bins, scaled so that its variance is that of the noise.
struct Weights {
    /// The first of the bins.
    first: usize,
    /// The weight of each.
    of: Vec<C>,
}

impl Weights {
    fn new(inputs: &[Vec<C>], k: usize, reach: usize) -> Self {
        // The first bin holds the mean and the trend, which were removed.
        let first = (k.max(reach + 1) - reach).min(inputs[0].len() - 2 * reach - 1);
        let basis = basis(inputs, k, [first, reach]);
        let centre = k - first.min(k);
        let own = |i: usize| if i == centre { C::ONE } else { C::ZERO };
        let left = |i: usize| own(i) - basis.iter().map(|q| q[centre] * q[i].conj()).sum::<C>();
        let taken: f64 = basis.iter().map(|q| q[centre].norm_sqr()).sum();
        let scale = (1.0 - taken).max(DEPENDENT).sqrt().recip();
        Self { first, of: (0..=2 * reach).map(|i| left(i) * scale).collect() }
    }

    fn applied(&self, y: &[C]) -> C {
        self.of.iter().zip(&y[self.first..]).map(|(weight, y)| weight * y).sum()
    }

    /// Returns the correlation of two residuals.
    fn times(&self, other: &Self) -> C {
        let [a, b] = if self.first < other.first { [self, other] } else { [other, self] };
        let apart = (b.first - a.first).min(a.of.len());
        a.of[apart..].iter().zip(&b.of).map(|(a, b)| a * b.conj()).sum()
    }
}

/// Returns the number of independent real values with the scatter of the mean power of the residuals: neighbouring
/// residuals are correlated, because each is what a fit to its neighbours leaves.
fn freedom(weights: &[Weights]) -> f64 {
    // The bins that a noise model counts.
    let counted = &weights[2..weights.len() - 1];
    let reached = |k: usize| &counted[k + 1..(k + counted[k].of.len()).min(counted.len())];
    let beside = |k: usize| reached(k).iter().map(|other| counted[k].times(other).norm_sqr()).sum::<f64>();
    let own = |k: usize| counted[k].times(&counted[k]).norm_sqr();
    let squares: f64 = (0..counted.len()).map(|k| own(k) + 2.0 * beside(k)).sum();
    2.0 * (counted.len() as f64).powi(2) / squares
}

/// Returns a basis of the parts that the inputs and a transient may have in the bins about a frequency.
fn basis(inputs: &[Vec<C>], k: usize, [first, reach]: [usize; 2]) -> Vec<DVector<C>> {
    let local = |of: &[C]| DVector::from_column_slice(&of[first..=first + 2 * reach]);
    let power = |degree: usize| move |i: usize| ((i + first) as f64 - k as f64).powi(degree as i32);
    let constant = DVector::repeat(2 * reach + 1, C::ONE);
    let signals = inputs.iter().map(|u| local(u)).chain(once(constant));
    let regressors = signals.flat_map(|signal| {
        repeat_n(signal, DEGREE + 1).enumerate().map(|(d, x)| DVector::from_fn(x.len(), |i, _| x[i] * power(d)(i)))
    });
    orthonormal(regressors)
}

/// Returns an orthonormal basis of the space of these vectors (modified Gram-Schmidt, twice).
fn orthonormal(vectors: impl Iterator<Item = DVector<C>>) -> Vec<DVector<C>> {
    let mut basis: Vec<DVector<C>> = Vec::new();
    for mut v in vectors {
        let size = v.norm_squared();
        for q in basis.iter().chain(&basis) {
            let along = q.dotc(&v);
            v.axpy(-along, q, C::ONE);
        }
        let left = v.norm_squared();
        if left > DEPENDENT * size {
            basis.push(v.unscale(left.sqrt()));
        }
    }
    basis
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::case::record::rms;
    use crate::noise::NoiseModel;
    use crate::plant::Plant;
    use crate::testing;

    /// A single driven record shows the noise of its sensors, which is far below the error of a simulation whose
    /// frequencies are off by 2 %.
    #[test]
    fn one_driven_record_shows_its_noise() {
        let real = testing::truss(3);
        let sim = testing::truss_with(3, |modes, _, _| modes.iter_mut().for_each(|(hz, _)| *hz *= 1.02));
        let case = testing::case(&sim, &real);
        let noise = case.model.as_ref().unwrap().noise.sensor_std.clone().unwrap();
        let record = &case.records[1];
        let error = record.error(&testing::run(&sim, &record.u));
        let assumed: Vec<f64> = record.y.iter().map(|y| 0.01 * rms(y)).collect();
        let declared = NoiseModel::declared(&Plant::new(&sim).unwrap(), &assumed, &[0.0; 2]);
        let found = declared.fit(&[unexplained(record, &error).unwrap()]).sensors();
        for (o, (found, noise)) in found.iter().zip(&noise).enumerate() {
            assert!(rms(&error[o]) > 10.0 * noise, "{} {noise}", rms(&error[o]));
            assert!((found.sqrt() / noise - 1.0).abs() < 0.2, "{} {noise}", found.sqrt());
        }
    }

    #[test]
    fn missing_samples_and_short_records_show_nothing() {
        let model = testing::truss(3);
        let mut record = testing::case(&model, &model).records[1].clone();
        let short = record.part(0..40, model.sample_rate_hz);
        assert!(unexplained(&short, &short.y).is_none());
        record.y[0][7] = f64::NAN;
        assert!(unexplained(&record, &record.y).is_none());
    }
}
