//! Removal of a line whose phase wanders: everything that a slowly modulated sine can contribute to a record is removed
//! from it.

use std::f64::consts::TAU;

use nalgebra::{Cholesky, Const, DMatrix, DVector, Matrix2, Vector2};

use crate::case::record::Channels;
use crate::plant::{Mode, Plant};
use plid_fourier::C;

/// Distance in s between the nodes of the modulation, which is linear between them. If the phase of a line wanders by
/// one radian in a second, a hundredth of the line's power remains.
const SPACING_S: f64 = 0.1;

/// Distance in Hz from the line within which nothing remains. Fits to such a residual leave these frequencies out.
pub const HOLE_HZ: f64 = 0.6 / SPACING_S;

/// Returns the number of pieces between the nodes of the modulation of a record, and the distance of the nodes in s.
fn pieces(samples: usize, rate: f64) -> (usize, f64) {
    let duration = (samples.max(2) - 1) as f64 / rate;
    let pieces = (duration / SPACING_S).ceil().max(1.0);
    (pieces as usize, duration / pieces)
}

/// Returns the cosine and the sine at a frequency, each modulated by adjacent hat functions: samples x columns.
pub fn modulated(samples: usize, rate: f64, hz: f64) -> DMatrix<f64> {
    let (pieces, spacing) = pieces(samples, rate);
    DMatrix::from_fn(samples, 2 * (pieces + 1), |k, j| piece(j, spacing, hz, k as f64 / rate))
}

/// Returns the cosine (even j) or the sine (odd j) at a frequency under hat function j / 2.
fn piece(j: usize, spacing: f64, hz: f64, t: f64) -> f64 {
    let hat = (1.0 - (t / spacing - (j / 2) as f64).abs()).max(0.0);
    let phase = TAU * hz * t;
    hat * if j.is_multiple_of(2) { phase.cos() } else { phase.sin() }
}

/// Returns the free decays of all modes, as cosine and sine: p channels each. There are none in closed loop, where no
/// mode decays by itself.
pub fn decays(plant: &Plant, samples: usize) -> Vec<Channels> {
    let decay = |mode: &Mode, phase: C| -> Channels {
        let turn = (mode.pole / plant.rate).exp();
        let of = |c: &C| (0..samples).scan(c * phase, |z, _| Some(std::mem::replace(z, *z * turn).re)).collect();
        mode.c.iter().map(of).collect()
    };
    let modes = if plant.controller.is_some() { &[][..] } else { &plant.modes };
    modes.iter().flat_map(|mode| [decay(mode, C::ONE), decay(mode, C::I)]).collect()
}

/// Returns the channels without a modulated line at this frequency and without free decays.
pub fn without_both(y: &[Vec<f64>], plant: &Plant, hz: f64) -> Vec<Vec<f64>> {
    let left = without(y, plant.rate, hz);
    let samples = y.first().map_or(0, Vec::len);
    let decays = decays(plant, samples);
    let columns: Vec<f64> = decays.iter().flat_map(|y| without(y, plant.rate, hz).concat()).collect();
    let basis = DMatrix::from_vec(samples * y.len(), decays.len(), columns).qr().q();
    let left = DVector::from_vec(left.concat());
    let left = &left - &basis * basis.tr_mul(&left);
    left.as_slice().chunks(samples.max(1)).map(<[f64]>::to_vec).collect()
}

/// The least-squares fit of a modulated line to signals. A hat function overlaps only its neighbours, so the normal
/// equations are block tridiagonal, and memory and time are proportional to the number of samples.
struct Line {
    rate: f64,
    hz: f64,
    pieces: usize,
    spacing: f64,
    /// For each node, the factor of what the elimination of the nodes before it leaves of its own products.
    own: Vec<Cholesky<f64, Const<2>>>,
    /// The products of the functions at each node with those at the next one.
    beside: Vec<Matrix2<f64>>,
}

impl Line {
    /// Prepares the fit; `None` if the samples do not determine the modulation.
    fn new(samples: usize, rate: f64, hz: f64) -> Option<Self> {
        let (pieces, spacing) = pieces(samples, rate);
        if 2 * (pieces + 1) > samples {
            return None;
        }
        let beside = vec![Matrix2::<f64>::zeros(); pieces];
        let mut line = Self { rate, hz, pieces, spacing, own: Vec::with_capacity(pieces + 1), beside };
        let mut products = vec![Matrix2::<f64>::zeros(); pieces + 1];
        for k in 0..samples {
            let (node, [before, after]) = line.at(k);
            products[node] += before * before.transpose();
            products[node + 1] += after * after.transpose();
            line.beside[node] += before * after.transpose();
        }
        for (node, mut left) in products.into_iter().enumerate() {
            if node > 0 {
                let beside = line.beside[node - 1];
                left -= beside.transpose() * line.own[node - 1].solve(&beside);
            }
            line.own.push(left.cholesky()?);
        }
        Some(line)
    }

    /// Returns the node before a sample, with the cosine and the sine at the sample under the hat function of this node
    /// and under that of the next one.
    fn at(&self, k: usize) -> (usize, [Vector2<f64>; 2]) {
        let t = k as f64 / self.rate;
        let node = ((t / self.spacing) as usize).min(self.pieces - 1);
        let of = |j: usize| piece(j, self.spacing, self.hz, t);
        let both = |node: usize| Vector2::new(of(2 * node), of(2 * node + 1));
        (node, [both(node), both(node + 1)])
    }

    /// Returns a signal without the line.
    fn taken_from(&self, y: &[f64]) -> Vec<f64> {
        let mut sums = vec![Vector2::<f64>::zeros(); self.pieces + 1];
        for (k, y) in y.iter().enumerate() {
            let (node, [before, after]) = self.at(k);
            sums[node] += before * *y;
            sums[node + 1] += after * *y;
        }
        for node in 0..self.pieces {
            let eliminated = self.beside[node].transpose() * self.own[node].solve(&sums[node]);
            sums[node + 1] -= eliminated;
        }
        // From the last node back, each sum is replaced by the coefficients of its node.
        sums[self.pieces] = self.own[self.pieces].solve(&sums[self.pieces]);
        for node in (0..self.pieces).rev() {
            let rest = sums[node] - self.beside[node] * sums[node + 1];
            sums[node] = self.own[node].solve(&rest);
        }
        let left = |(k, y): (usize, &f64)| {
            let (node, [before, after]) = self.at(k);
            y - before.dot(&sums[node]) - after.dot(&sums[node + 1])
        };
        y.iter().enumerate().map(left).collect()
    }
}

/// Returns the channels without a modulated line at this frequency, which is fitted by least squares. If the samples do
/// not determine the line, the channels are returned as they are.
pub fn without(y: &[Vec<f64>], rate: f64, hz: f64) -> Vec<Vec<f64>> {
    let line = y.first().and_then(|first| Line::new(first.len(), rate, hz));
    line.map_or_else(|| y.to_vec(), |line| y.iter().map(|y| line.taken_from(y)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::random_input;

    /// If the phase of a line wanders by one radian in a second, less than a hundredth of the line's power remains.
    /// Nearly all of the noise remains.
    #[test]
    fn a_line_that_walks_is_taken_out() {
        let (rate, hz, samples) = (1600.0, 97.3, 4800);
        let steps = random_input(5, samples, 1).remove(0);
        let mut phase = 0.0;
        let mut line = Vec::new();
        for (k, step) in steps.iter().enumerate() {
            phase += step / f64::sqrt(rate);
            line.push((TAU * hz * k as f64 / rate + phase).sin());
        }
        let power = |y: &[f64]| y.iter().map(|y| y * y).sum::<f64>() / samples as f64;
        let noise = random_input(6, samples, 1).remove(0);
        let left = without(&[line, noise], rate, hz);
        assert!(power(&left[0]) < 0.01, "{}", power(&left[0]));
        assert!(power(&left[1]) > 0.97, "{}", power(&left[1]));
    }

    /// The elimination from node to node gives the least-squares fit, for lines far below 10 Hz as well.
    #[test]
    fn a_line_is_fitted_by_least_squares() {
        for (rate, samples) in [(25.0, 301), (200.0, 1001), (1600.0, 1600)] {
            let y = random_input(7, samples, 2);
            for hz in [0.5, 2.3, 9.7, 0.43 * rate] {
                let basis = modulated(samples, rate, hz).qr().q();
                for (y, left) in y.iter().zip(without(&y, rate, hz)) {
                    let y = DVector::from_column_slice(y);
                    let expected = &y - &basis * basis.tr_mul(&y);
                    let far = (DVector::from_vec(left) - expected).amax();
                    assert!(far < 1e-6, "{rate} {hz}: {far}");
                }
            }
        }
    }

    /// A record of a quarter of an hour would need tens of gigabytes as a matrix. Too few samples show no line.
    #[test]
    fn a_long_record_needs_little_memory() {
        let (rate, hz, samples) = (200.0, 3.0, 200_000);
        let line: Vec<f64> = (0..samples).map(|k| (TAU * hz * f64::from(k) / rate).sin()).collect();
        let noise = random_input(8, samples as usize, 1).remove(0);
        let power = |y: &[f64]| y.iter().map(|y| y * y).sum::<f64>() / f64::from(samples);
        let left = without(&[line, noise.clone()], rate, hz);
        assert!(power(&left[0]) < 1e-12, "{}", power(&left[0]));
        assert!((0.88..0.92).contains(&power(&left[1])), "{}", power(&left[1]));
        assert_eq!(without(std::slice::from_ref(&noise), 1.0, 0.3), [noise]);
    }
}
