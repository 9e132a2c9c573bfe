//! Whitening of one record at a time: y(f) -> L(f)^{-1} y(f) with S(f) = L(f) L(f)^H.
//!
//! The sum of squares of the whitened residual is minus twice the log likelihood, up to a constant, and can be
//! compared between explanations.

use std::ops::{Range, RangeInclusive};
use std::sync::Arc;

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use nalgebra::DMatrix;

use crate::case::record::{Channels, Record};
use crate::noise::NoiseModel;
use crate::noise::bridge::Bridge;
use crate::noise::expected::periodograms;
use crate::signal::notch;
use plid_fourier::C;

/// The whitening of one record.
#[derive(Debug, Clone)]
pub struct Whitener {
    /// Number of samples used. The last few are left out if the transform would otherwise be slow.
    pub length: usize,
    /// Samples of each channel that are ignored, such as dropouts and missing samples: p lists of indices in order.
    pub masked: Vec<Vec<usize>>,
    p: usize,
    /// The bins that count.
    bins: RangeInclusive<usize>,
    /// Lower triangles of L^{-1} of each bin, row by row.
    factors: Vec<C>,
    /// The bridges over ignored samples, if there are any.
    bridge: Option<Arc<Bridge>>,
    /// The subspaces that are removed: their rows, and an orthonormal basis in these rows.
    taken_out: Vec<(Range<usize>, DMatrix<f64>)>,
}

/// Distance from a line, in Hz, up to which its modulation is removed. Beyond it, the leakage from the ends of the
/// line in the record is less than the noise of a twelve-bit converter.
const MODULATION_HZ: f64 = 25.0;

/// Largest factor by which bridges may scale what they are to remove. If the inverse of the density has a narrow peak,
/// distant missing samples depend on each other, and bridges that are independent of each other remove it twice.
const MOST_COUPLED: f64 = 1.5;

/// Number of steps of the power iteration for this factor.
const COUPLING_STEPS: usize = 6;

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
        let masked = with_missing(&masked, record);
        let mut whitener = Self { length, masked, p, bins, factors, bridge: None, taken_out: Vec::new() };
        // Outside a band, nothing determines the values of missing samples, so they stay zero.
        whitener.bridge = if noise.band_hz.is_some() { None } else { whitener.bridged() };
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
    /// adjacent to each other. Ignored samples have the values that the noise model leads one to expect.
    pub fn apply(&self, y: &[Vec<f64>], to: &mut [f64]) {
        let mut used = self.used(y);
        if let Some(bridge) = &self.bridge {
            self.whiten(used.clone(), to);
            subtract(&mut used, &bridge.values(&self.products(to)));
        }
        self.whiten(used, to);
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
        let mut y = self.products(&white);
        if let Some(bridge) = &self.bridge {
            self.whiten(bridge.values(&y), &mut white);
            subtract(&mut y, &self.products(&white));
        }
        for (channel, y) in y.iter_mut().enumerate() {
            self.masked_samples(channel).for_each(|k| y[k] = 0.0);
        }
        y
    }

    /// Returns the number of values of an output that count in a sum of squares: its rows, less its share of ignored
    /// samples.
    pub fn values_of(&self, output: usize) -> f64 {
        let ignored = self.masked_samples(output).count() as f64 / self.length as f64;
        self.rows() as f64 / self.p as f64 * (1.0 - ignored)
    }

    /// Returns the number of values of all outputs that count in a sum of squares.
    pub fn values(&self) -> f64 {
        (0..self.p).map(|output| self.values_of(output)).sum()
    }

    /// Returns the output to which a row belongs. Whitening subtracts from it what the outputs before it predict.
    pub fn output_of(&self, row: usize) -> usize {
        let first = if *self.bins.start() == 0 { self.p } else { 0 };
        let last = if 2 * self.bins.end() == self.length { self.rows() - self.p } else { self.rows() };
        match row {
            row if row < first => row,
            row if row >= last => row - last,
            row => (row - first) / 2 % self.p,
        }
    }

    /// Returns the samples that are used, with zeros in the place of ignored ones.
    fn used(&self, y: &[Vec<f64>]) -> Channels {
        let one = |channel: usize| {
            let mut y = y[channel][..self.length].to_vec();
            self.masked_samples(channel).for_each(|k| y[k] = 0.0);
            y
        };
        (0..self.p).map(one).collect()
    }

    /// Writes the whitened bins of channels all of whose samples are used.
    fn whiten(&self, y: Channels, to: &mut [f64]) {
        let scale = 1.0 / (self.length as f64).sqrt();
        let bins: Vec<Vec<C>> = y.into_iter().map(|mut y| plid_fourier::forward_of(&mut y)).collect();
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
    }

    /// Returns the inner products of whitened bins with the whitened unit impulses at all samples.
    fn products(&self, white: &[f64]) -> Channels {
        // The inverse transform counts each bin between the edges twice, and divides by the length.
        let scale = (self.length as f64).sqrt();
        let each = self.p * (self.p + 1) / 2;
        let mut bins = vec![vec![C::ZERO; self.length / 2 + 1]; self.p];
        let mut rest = white;
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
        bins.into_iter().map(|bins| plid_fourier::backward(&bins, self.length)).collect()
    }

    /// Returns the bridges over the ignored samples; `None` if there are none, or if distant ones depend too much on
    /// each other to be bridged independently.
    fn bridged(&self) -> Option<Arc<Bridge>> {
        let ignored: Vec<Vec<usize>> = (0..self.p).map(|channel| self.masked_samples(channel).collect()).collect();
        if ignored.iter().all(Vec::is_empty) {
            return None;
        }
        let kernel = |channel: usize| {
            let mut impulse = vec![vec![0.0; self.length]; self.p];
            impulse[channel][0] = 1.0;
            let mut white = vec![0.0; self.rows()];
            self.whiten(impulse, &mut white);
            self.products(&white)
        };
        let kernels: Vec<Channels> = (0..self.p).map(kernel).collect();
        let bridge = Bridge::new(&ignored, &kernels);
        (self.largest_factor(&bridge) < MOST_COUPLED).then(|| Arc::new(bridge))
    }

    /// Returns the largest factor by which bridges scale what they are to remove, by power iteration. It is one if
    /// they are exact.
    fn largest_factor(&self, bridge: &Bridge) -> f64 {
        let scattered = |k: usize| (k as f64 * k as f64).sin();
        let start = vec![(0..self.length).map(scattered).collect::<Vec<f64>>(); self.p];
        let mut white = vec![0.0; self.rows()];
        let size = |x: &Channels| x.iter().flatten().map(|x| x * x).sum::<f64>().sqrt();
        let (mut values, mut factor) = (bridge.values(&start), 0.0);
        for _ in 0..COUPLING_STEPS {
            let before = size(&values);
            if before == 0.0 {
                break;
            }
            self.whiten(values, &mut white);
            values = bridge.values(&self.products(&white));
            factor = size(&values) / before;
        }
        factor
    }

    fn masked_samples(&self, channel: usize) -> impl Iterator<Item = usize> {
        self.masked[channel].iter().copied().filter(|&k| k < self.length)
    }
}

/// Returns the samples of each channel that are ignored, in order: these and those that the record lacks.
fn with_missing(masked: &[Vec<usize>], record: &Record) -> Vec<Vec<usize>> {
    let of_channel = |(masked, y): (&Vec<usize>, &Vec<f64>)| -> Vec<usize> {
        let mut ignored: Vec<bool> = y.iter().map(|y| !y.is_finite()).collect();
        masked.iter().filter(|&&k| k < y.len()).for_each(|&k| ignored[k] = true);
        (0..y.len()).filter(|&k| ignored[k]).collect()
    };
    masked.iter().zip(&record.y).map(of_channel).collect()
}

/// Subtracts channels from others.
fn subtract(from: &mut [Vec<f64>], what: &[Vec<f64>]) {
    for (from, what) in from.iter_mut().zip(what) {
        from.iter_mut().zip(what).for_each(|(from, what)| *from -= what);
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
    use crate::noise::{Band, Slow, Source, Stretch};
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

    /// Missing samples of slow noise do not add power at other frequencies, and do not count.
    #[test]
    fn missing_samples_do_not_leak() {
        const SAMPLES: usize = 4000;
        const CORNER: f64 = 4.0;
        let plant = Plant::new(&truss(2)).unwrap();
        let pole = (-std::f64::consts::TAU * CORNER / RATE).exp();
        let mut noise = NoiseModel::declared(&plant, &vec![1.0; plant.p], &vec![0.0; plant.m]);
        for output in 0..plant.p {
            noise.sources.push((Source::Slow(Slow { output, hz: CORNER }), 100.0 * (1.0 + pole) / (1.0 - pole)));
        }
        let mut y = random_input(81, SAMPLES, plant.p);
        for (y, fresh) in y.iter_mut().zip(random_input(82, SAMPLES, plant.p)) {
            let mut state = 0.0;
            for (y, fresh) in y.iter_mut().zip(fresh) {
                state = pole * state + (1.0 - pole * pole).sqrt() * fresh;
                *y += 10.0 * state;
            }
        }
        let power = |y: &Channels| {
            let record = crate::testing::record(vec![vec![0.0; SAMPLES]; plant.m], y.clone());
            let whitener = Whitener::new(&record, &noise, RATE, vec![Vec::new(); plant.p]);
            let mut white = vec![0.0; whitener.rows()];
            whitener.apply(&record.error(&vec![vec![0.0; SAMPLES]; plant.p]), &mut white);
            (white.iter().map(|x| x * x).sum::<f64>(), whitener.values())
        };
        let (whole, rows) = power(&y);
        for y in &mut y {
            (7..SAMPLES).step_by(97).for_each(|k| y[k] = f64::NAN);
            y[2000..2100].fill(f64::NAN);
        }
        let missing = y.iter().flatten().filter(|y| y.is_nan()).count() as f64;
        let (left, values) = power(&y);
        assert!((rows - values - missing).abs() < 1e-6, "{rows} {values} {missing}");
        let ratio = left / values / (whole / rows);
        assert!((ratio - 1.0).abs() < 0.03, "{ratio}");
    }

    /// Where the values of missing samples are not determined, because only a band counts or because the noise is much
    /// weaker in a narrow band than elsewhere, their number of values stays right for noise.
    #[test]
    fn missing_samples_do_not_take_a_band_out() {
        const SAMPLES: usize = 4000;
        let plant = Plant::new(&truss(2)).unwrap();
        let mut y = random_input(83, SAMPLES, plant.p);
        y.iter_mut().for_each(|y| (0..SAMPLES).step_by(34).for_each(|k| y[k] = f64::NAN));
        let record = crate::testing::record(vec![vec![0.0; SAMPLES]; plant.m], y);
        let mut noise = NoiseModel::declared(&plant, &vec![1.0; plant.p], &vec![0.0; plant.m]);
        for share in [0.01, 0.05, 0.3] {
            noise.band_hz = Some([10.0, 10.0 + 0.5 * share * RATE]);
            let whitener = Whitener::new(&record, &noise, RATE, vec![Vec::new(); plant.p]);
            let mut white = vec![0.0; whitener.rows()];
            whitener.apply(&record.error(&vec![vec![0.0; SAMPLES]; plant.p]), &mut white);
            let power = white.iter().map(|x| x * x).sum::<f64>() / whitener.values();
            assert!((power - 1.0).abs() < 0.3, "{share}: {power}");
        }
        noise.band_hz = None;
        let mut whitener = Whitener::new(&record, &noise, RATE, vec![Vec::new(); plant.p]);
        assert!(whitener.bridge.is_some());
        let (each, bins) = (plant.p * (plant.p + 1) / 2, SAMPLES / 2);
        whitener.factors[..each * bins / 100].iter_mut().for_each(|factor| *factor *= 100.0);
        assert!(whitener.bridged().is_none());
    }

    /// With independent outputs, the rows of an output are those that it alone reaches.
    #[test]
    fn rows_belong_to_outputs() {
        let plant = Plant::new(&truss(2)).unwrap();
        for (samples, band_hz) in [(400, None), (405, None), (400, Some([20.0, 0.4 * RATE]))] {
            let mut y = random_input(5, samples, plant.p);
            let record = crate::testing::record(vec![vec![0.0; samples]; plant.m], y.clone());
            let mut noise = NoiseModel::declared(&plant, &vec![1.0; plant.p], &vec![0.0; plant.m]);
            noise.band_hz = band_hz;
            let whitener = Whitener::new(&record, &noise, RATE, vec![Vec::new(); plant.p]);
            y[0].fill(0.0);
            let mut white = vec![0.0; whitener.rows()];
            whitener.apply(&y, &mut white);
            assert!((0..white.len()).all(|row| (white[row] != 0.0) == (whitener.output_of(row) == 1)));
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
