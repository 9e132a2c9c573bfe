//! Whitening of one record at a time: y(f) -> L(f)^{-1} y(f) with S(f) = L(f) L(f)^H.
//!
//! The sum of squares of the whitened residual is minus twice the log likelihood, up to a constant, and can be
//! compared between explanations.

use std::ops::{Range, RangeInclusive};

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use nalgebra::DMatrix;

use crate::case::record::{Channels, Record};
use crate::noise::NoiseModel;
use crate::noise::expected::periodograms;
use crate::signal::notch;
use plid_fourier::C;

/// The whitening of one record.
#[derive(Debug, Clone)]
pub struct Whitener {
    /// Number of samples used. The last few are left out if the transform would otherwise be slow.
    pub length: usize,
    /// Samples of each channel that are ignored, such as dropouts: p lists of indices.
    pub masked: Vec<Vec<usize>>,
    p: usize,
    /// The bins that count.
    bins: RangeInclusive<usize>,
    /// Lower triangles of L^{-1} of each bin, row by row.
    factors: Vec<C>,
    /// The subspaces that are removed: their rows, and an orthonormal basis in these rows.
    taken_out: Vec<(Range<usize>, DMatrix<f64>)>,
}

/// Distance from a line, in Hz, up to which its modulation is removed. Beyond it, the leakage from the ends of the
/// line in the record is less than the noise of a twelve-bit converter.
const MODULATION_HZ: f64 = 25.0;

impl Whitener {
    /// Creates the whitening of a record under a noise model.
    pub fn new(record: &Record, noise: &NoiseModel, rate: f64, masked: Vec<Vec<usize>>) -> Self {
        let length = plid_fourier::good_length_below(record.samples());
        let p = record.y.len();
        let level = record.level();
        let mut factors = Vec::new();
        let bins = counted(noise.band_hz, rate / length as f64, length / 2);
        let closed = noise.plant().controller.is_some();
        let smooth = if closed { periodograms(|hz| noise.density(hz), rate, length) } else { Vec::new() };
        for k in bins.clone() {
            let hz = k as f64 * rate / length as f64;
            let mut density = smooth.get(k).cloned().unwrap_or_else(|| noise.density(hz));
            if let Some(error) = &noise.model_error {
                (0..p).for_each(|o| density[(o, o)] += C::from(error.density(o, hz, level)));
            }
            // Outputs may differ in unit by many orders of magnitude, so each has its own floor.
            for i in 0..p {
                let floor = 1e-12 * density[(i, i)].re;
                density[(i, i)] += C::from(floor);
            }
            let lower = density.cholesky().map_or_else(|| DMatrix::identity(p, p), |c| c.l());
            let inverse = lower.try_inverse().unwrap_or_else(|| DMatrix::identity(p, p));
            for i in 0..p {
                factors.extend((0..=i).map(|j| inverse[(i, j)]));
            }
        }
        let mut whitener = Self { length, masked, p, bins, factors, taken_out: Vec::new() };
        for &(_, hz) in &noise.lines {
            whitener.take_out(hz, rate);
        }
        // Forces in bands make resonances ring at both ends of the record. The Fourier transform spreads this ringing
        // to frequencies at which the density is small.
        if noise.drives() {
            whitener.take_out_all(&notch::decays(noise.plant(), length));
        }
        whitener
    }

    /// Also removes the subspace that these channels span.
    fn take_out_all(&mut self, traces: &[Channels]) {
        let mut white = vec![0.0; self.rows()];
        let mut basis = DMatrix::zeros(self.rows(), traces.len());
        for (j, y) in traces.iter().enumerate() {
            self.apply(y, &mut white);
            basis.column_mut(j).copy_from_slice(&white);
        }
        self.taken_out.push((0..self.rows(), basis.qr().q()));
    }

    /// Removes the subspace of a slowly modulated line, at each output separately.
    fn take_out(&mut self, hz: f64, rate: f64) {
        let step = rate / self.length as f64;
        let bin = |hz: f64| ((hz / step).round().max(0.0) as usize).clamp(*self.bins.start(), *self.bins.end());
        let first_row =
            |k: usize| 2 * self.p * (k - self.bins.start()) - if *self.bins.start() == 0 { self.p } else { 0 };
        let (from, to) =
            (bin(hz - MODULATION_HZ).max(self.bins.start() + 1), bin(hz + MODULATION_HZ).saturating_sub(1));
        if to <= from {
            return;
        }
        let rows = first_row(from)..first_row(to + 1);
        let shapes = notch::modulated(self.length, rate, hz);
        let mut white = vec![0.0; self.rows()];
        let mut basis = DMatrix::zeros(rows.len(), self.p * shapes.ncols());
        for o in 0..self.p {
            let mut y = vec![vec![0.0; self.length]; self.p];
            for (j, shape) in shapes.column_iter().enumerate() {
                y[o].copy_from_slice(shape.as_slice());
                self.apply(&y, &mut white);
                basis.column_mut(o * shapes.ncols() + j).copy_from_slice(&white[rows.clone()]);
            }
        }
        self.taken_out.push((rows, basis.qr().q()));
    }

    /// Returns the number of values that [`Whitener::apply`] writes.
    pub fn rows(&self) -> usize {
        // The bins at zero and at half the rate are real. A band may contain one of them alone.
        let edges = self.bins.clone().filter(|&k| k == 0 || 2 * k == self.length).count();
        self.p * (2 * self.bins.clone().count() - edges)
    }

    /// Writes the whitened bins of p channels to `to`, in order of rising frequency and with all channels of a bin
    /// adjacent to each other.
    pub fn apply(&self, y: &[Vec<f64>], to: &mut [f64]) {
        let scale = 1.0 / (self.length as f64).sqrt();
        let bins: Vec<Vec<C>> = (0..self.p).map(|o| self.bins(&y[o], o)).collect();
        let mut at = 0;
        let each = self.p * (self.p + 1) / 2;
        for (index, k) in self.bins.clone().enumerate() {
            let edge = k == 0 || 2 * k == self.length;
            let weight = if edge { scale } else { scale * std::f64::consts::SQRT_2 };
            let factors = &self.factors[index * each..(index + 1) * each];
            let mut next = 0;
            for i in 0..self.p {
                let mut sum = C::ZERO;
                for bins in &bins[..=i] {
                    sum += factors[next] * bins[k];
                    next += 1;
                }
                to[at] = sum.re * weight;
                at += 1;
                if !edge {
                    to[at] = sum.im * weight;
                    at += 1;
                }
            }
        }
        for (rows, basis) in &self.taken_out {
            take_out(basis, &mut to[rows.clone()]);
        }
    }

    /// Returns the adjoint: the channels whose inner product with any outputs is that of `white` with the whitened
    /// outputs. Only samples that are used are returned.
    pub fn adjoint(&self, white: &[f64]) -> Channels {
        let mut white = white.to_vec();
        for (rows, basis) in self.taken_out.iter().rev() {
            take_out(basis, &mut white[rows.clone()]);
        }
        // The inverse transform counts each bin between the edges twice, and divides by the length.
        let scale = (self.length as f64).sqrt();
        let each = self.p * (self.p + 1) / 2;
        let mut bins = vec![vec![C::ZERO; self.length / 2 + 1]; self.p];
        let mut rest = white.as_slice();
        for (factors, k) in self.factors.chunks_exact(each).zip(self.bins.clone()) {
            let edge = k == 0 || 2 * k == self.length;
            let weight = if edge { scale } else { scale * std::f64::consts::FRAC_1_SQRT_2 };
            let mut next = 0;
            for i in 0..self.p {
                let value = if edge { C::from(rest[0]) } else { C::new(rest[0], rest[1]) };
                rest = &rest[if edge { 1 } else { 2 }..];
                for bins in &mut bins[..=i] {
                    bins[k] += factors[next].conj() * value * weight;
                    next += 1;
                }
            }
        }
        let back = |(channel, bins): (usize, Vec<C>)| {
            let mut y = plid_fourier::backward(&bins, self.length);
            self.masked_samples(channel).for_each(|k| y[k] = 0.0);
            y
        };
        bins.into_iter().enumerate().map(back).collect()
    }

    fn bins(&self, y: &[f64], channel: usize) -> Vec<C> {
        let mut y = y[..self.length].to_vec();
        self.masked_samples(channel).for_each(|k| y[k] = 0.0);
        plid_fourier::forward_of(&mut y)
    }

    fn masked_samples(&self, channel: usize) -> impl Iterator<Item = usize> {
        self.masked[channel].iter().copied().filter(|&k| k < self.length)
    }
}

/// Removes the subspace that a basis spans.
fn take_out(basis: &DMatrix<f64>, white: &mut [f64]) {
    let (rows, columns) = basis.shape();
    let basis = MatRef::from_column_major_slice(basis.as_slice(), rows, columns);
    let mut inside = vec![0.0; columns];
    let column = MatMut::from_column_major_slice_mut(&mut inside, columns, 1);
    let white = MatMut::from_column_major_slice_mut(white, rows, 1);
    matmul(column, Accum::Replace, basis.transpose(), white.as_ref(), 1.0, Par::Seq);
    let inside = MatRef::from_column_major_slice(&inside, columns, 1);
    matmul(white, Accum::Add, basis, inside, -1.0, Par::Seq);
}

/// Returns the bins from 0 to `last` that lie in the band; all of them if none does.
fn counted(band_hz: Option<[f64; 2]>, step: f64, last: usize) -> RangeInclusive<usize> {
    let Some([from, to]) = band_hz else { return 0..=last };
    let (first, end) = ((from / step).ceil() as usize, ((to / step).floor() as usize).min(last));
    if first <= end { first..=end } else { 0..=last }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::case::record::Excitation;
    use crate::effects::Action;
    use crate::noise::{Band, Source, Stretch};
    use crate::plant::Plant;
    use crate::simulate::{Fineness, simulate};
    use crate::testing::{RATE, random_input, truss};

    /// The unit of one output does not change the weight of another.
    #[test]
    fn outputs_in_very_different_units_count_alike() {
        let plant = Plant::new(&truss(2)).unwrap();
        let error = random_input(5, 1000, 2);
        let whitened = |unit: f64| {
            let scaled: Channels = vec![error[0].iter().map(|e| unit * e).collect(), error[1].clone()];
            let record = crate::testing::record(vec![vec![0.0; 1000]; plant.m], scaled.clone());
            let noise = NoiseModel::declared(&plant, &[unit, 1.0], &vec![0.0; plant.m]);
            let whitener = Whitener::new(&record, &noise, RATE, vec![Vec::new(); 2]);
            let mut to = vec![0.0; whitener.rows()];
            whitener.apply(&scaled, &mut to);
            to
        };
        let (alike, apart) = (whitened(1.0), whitened(1e-9));
        assert!(alike.iter().zip(&apart).all(|(a, b)| (a - b).abs() < 1e-6 * (1.0 + a.abs())));
    }

    /// A force in a band drives a mode three hundred times above the sensor noise. The mode rings at the end of the
    /// record, and the Fourier transform spreads this ringing to all frequencies. The whitened record does not
    /// contain it.
    #[test]
    fn what_rings_where_a_record_is_cut_off_is_taken_out() {
        let (hz, before, samples, sensor) = (137.0, 3000, 2000, 1e-3);
        let plant = Plant::new(&truss(2)).unwrap();
        let (turn, radius) = (2.0 * (std::f64::consts::TAU * hz / RATE).cos(), 0.97);
        let white = random_input(71, before + samples, 1).remove(0);
        let mut force = vec![0.0; 2];
        for e in white {
            let [.., before, last] = force[..] else { unreachable!("it begins with two") };
            force.push(turn * last - radius * radius * before + e);
        }
        let of = move |t: f64| force[((t * RATE).round() as usize).min(force.len() - 1)];
        let quiet = vec![vec![0.0; before + samples]; plant.m];
        let driven = simulate(&plant, &[Action::Disturbance(0, Box::new(of))], &quiet, 0.0, None, Fineness::FINE);
        let strong = 300.0 * sensor / crate::case::record::rms(driven.iter().flatten());
        let noise = random_input(72, samples, plant.p);
        let of_channel = |(y, noise): (&Vec<f64>, &Vec<f64>)| -> Vec<f64> {
            y[before..].iter().zip(noise).map(|(y, e)| strong * y + sensor * e).collect()
        };
        let y: Channels = driven.iter().zip(&noise).map(of_channel).collect();
        let record = Record {
            excitation: Excitation::Zero,
            from_rest: false,
            ..crate::testing::record(vec![vec![0.0; samples]; plant.m], y)
        };
        let band = Band { slope: -1.0, ..Band::pass(0, hz, -2.0 * radius.ln() / (std::f64::consts::TAU * hz / RATE)) };
        let noise = NoiseModel::declared(&plant, &vec![sensor; plant.p], &vec![0.0; plant.m]);
        let noise = noise.fit_with(&[Stretch::new(&record.y).tapered()], &[Source::Band(band)], 60, 2);
        let whitener = Whitener::new(&record, &noise, RATE, vec![Vec::new(); plant.p]);
        let leaking = Whitener { taken_out: Vec::new(), ..whitener.clone() };
        let power = |whitener: &Whitener| {
            let mut white = vec![0.0; whitener.rows()];
            whitener.apply(&record.y, &mut white);
            white.iter().map(|x| x * x).sum::<f64>() / white.len() as f64
        };
        let (leaking, clear) = (power(&leaking), power(&whitener));
        assert!(leaking > 10.0 && (0.6..1.2).contains(&clear), "{leaking}, {clear}");
    }

    /// The identity <white, W y> = <W' white, y> holds with removed lines, masked samples and a band.
    #[test]
    fn the_adjoint_gives_the_same_products() {
        let plant = Plant::new(&truss(2)).unwrap();
        let y: Channels = random_input(5, 403, plant.p);
        let record = crate::testing::record(vec![vec![0.0; 403]; plant.m], y.clone());
        let mut noise = NoiseModel::declared(&plant, &vec![1.0; plant.p], &vec![0.1; plant.m]);
        for (band_hz, line) in [(None, false), (None, true), (Some([20.0, 0.4 * RATE]), true)] {
            noise.band_hz = band_hz;
            if line {
                noise.lines = vec![(0, 60.0), (0, 75.0)];
            }
            let whitener = Whitener::new(&record, &noise, RATE, vec![vec![3, 50]; plant.p]);
            let mut white = vec![0.0; whitener.rows()];
            whitener.apply(&y, &mut white);
            let other = random_input(6, whitener.rows(), 1).remove(0);
            let product: f64 = white.iter().zip(&other).map(|(a, b)| a * b).sum();
            let adjoint = whitener.adjoint(&other);
            let same: f64 = adjoint.iter().zip(&y).flat_map(|(a, y)| a.iter().zip(y)).map(|(a, b)| a * b).sum();
            assert!((same - product).abs() < 1e-9 * product.abs().max(1.0), "{same} {product}");
        }
    }

    #[test]
    fn a_band_may_hold_a_single_bin() {
        let plant = Plant::new(&truss(2)).unwrap();
        let y: Channels = random_input(5, 400, plant.p);
        let record = crate::testing::record(vec![vec![0.0; 400]; plant.m], y);
        let declared = NoiseModel::declared(&plant, &vec![1.0; plant.p], &vec![0.0; plant.m]);
        let step = RATE / 400.0;
        for (band_hz, real) in
            [([0.0, 0.5 * step], 1), ([199.5 * step, 200.0 * step], 1), ([2.9 * step, 3.1 * step], 2)]
        {
            let noise = NoiseModel { band_hz: Some(band_hz), ..declared.clone() };
            let whitener = Whitener::new(&record, &noise, RATE, vec![Vec::new(); plant.p]);
            assert_eq!(whitener.rows(), real * plant.p, "{band_hz:?}");
            let mut white = vec![0.0; whitener.rows()];
            whitener.apply(&record.y, &mut white);
            assert!(white.iter().all(|x| x.is_finite() && *x != 0.0), "{band_hz:?}");
        }
    }
}
