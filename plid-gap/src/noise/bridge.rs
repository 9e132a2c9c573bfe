//! Bridges over missing samples: the values that a spectrum leads one to expect there, given all other samples.
//!
//! With zeros in the place of missing samples, the power of slow or ringing noise spreads to frequencies at which the
//! noise is weak. The expected values minimise the whitened sum of squares over all frequencies. This is as if each
//! missing sample were a free parameter, so the sum has as many degrees of freedom as there are samples that are not
//! missing.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use plid_model::signal::mean;

use crate::case::record::Channels;
use plid_fourier::C;

/// Distance in samples beyond which missing samples are bridged independently. Of a longer gap, this many samples are
/// bridged at each end; the others stay zero.
const REACH: usize = 32;

/// Largest number of samples that are bridged together. It bounds the memory for each missing sample.
const TOGETHER: usize = 128;

/// Ridge relative to the mean diagonal. In a narrow band, neighbouring samples are almost dependent.
const RIDGE: f64 = 1e-9;

/// Number of rounds in which a spectrum and the missing samples are estimated from each other.
const ROUNDS: usize = 2;

/// Number of bins on either side over which the power of a signal is averaged.
const SMOOTHED: usize = 8;

/// Smallest power of a bin, relative to the largest.
const LEAST: f64 = 1e-12;

/// The bridges over the missing samples of a record.
#[derive(Debug, Clone)]
pub(super) struct Bridge {
    groups: Vec<Group>,
}

/// Samples that are bridged together.
#[derive(Debug, Clone)]
struct Group {
    /// The sample and the channel of each.
    at: Vec<(usize, usize)>,
    /// The factor of the inner products of their whitened unit impulses.
    factor: Cholesky<f64, Dyn>,
}

impl Bridge {
    /// Creates the bridges over these samples of each channel (p lists in order). `kernels[q][o][lag]` is the inner
    /// product of the whitened unit impulses at sample `lag` of channel `o` and at sample zero of channel `q`. Time is
    /// circular.
    pub fn new(missing: &[Vec<usize>], kernels: &[Channels]) -> Self {
        let length = kernels.first().map_or(0, |kernel| kernel[0].len());
        let product = |(k, o): (usize, usize), (l, q): (usize, usize)| kernels[q][o][(k + length - l) % length];
        let factored = |at: Vec<(usize, usize)>| -> Option<Group> {
            let mut normal = DMatrix::from_fn(at.len(), at.len(), |i, j| product(at[i], at[j]));
            let ridge = RIDGE * normal.trace() / at.len() as f64;
            (0..at.len()).for_each(|i| normal[(i, i)] += ridge);
            normal.cholesky().map(|factor| Group { at, factor })
        };
        Self { groups: groups(bridged(missing)).into_iter().filter_map(factored).collect() }
    }

    /// Returns the changes at the bridged samples (p channels, zero elsewhere) for channels whose inner products with
    /// the whitened unit impulses are `products`.
    pub fn values(&self, products: &[Vec<f64>]) -> Channels {
        let mut values: Channels = products.iter().map(|products| vec![0.0; products.len()]).collect();
        for Group { at, factor } in &self.groups {
            let right = DVector::from_iterator(at.len(), at.iter().map(|&(k, channel)| products[channel][k]));
            let solved = factor.solve(&right);
            for (&(k, channel), value) in at.iter().zip(solved.iter()) {
                values[channel][k] = *value;
            }
        }
        values
    }
}

/// Returns the samples that are bridged with their channels, in the order of time.
fn bridged(missing: &[Vec<usize>]) -> Vec<(usize, usize)> {
    let mut all = Vec::new();
    for (channel, missing) in missing.iter().enumerate() {
        for gap in missing.chunk_by(|a, b| a + 1 == *b) {
            let near_an_end = |k: &usize| (*k).min(gap.len() - 1 - *k) < REACH;
            all.extend((0..gap.len()).filter(near_an_end).map(|k| (gap[k], channel)));
        }
    }
    all.sort_unstable();
    all
}

/// Divides samples in the order of time into groups.
fn groups(all: Vec<(usize, usize)>) -> Vec<Vec<(usize, usize)>> {
    let mut groups: Vec<Vec<(usize, usize)>> = Vec::new();
    for sample in all {
        let joins = groups
            .last()
            .is_some_and(|group| group.len() < TOGETHER && group.last().is_some_and(|last| sample.0 - last.0 <= REACH));
        match groups.last_mut() {
            Some(group) if joins => group.push(sample),
            _ => groups.push(vec![sample]),
        }
    }
    groups
}

/// Replaces the missing samples of a signal, which are zero, by those that its own smoothed spectrum leads one to
/// expect. The first spectrum still contains what the zeros spread, so the values are found in rounds.
pub(super) fn by_own_spectrum(x: &mut [f64], missing: &[usize]) {
    let rounds = if missing.is_empty() { 0 } else { ROUNDS };
    for _ in 0..rounds {
        let bins = plid_fourier::forward(x);
        let power: Vec<f64> = bins.iter().map(C::norm_sqr).collect();
        let around = |k: usize| mean(&power[k.saturating_sub(SMOOTHED)..(k + SMOOTHED + 1).min(power.len())]);
        let smooth: Vec<f64> = (0..power.len()).map(around).collect();
        let largest = smooth.iter().copied().fold(0.0, f64::max);
        if largest <= 0.0 {
            return;
        }
        let inverse: Vec<f64> = smooth.iter().map(|power| 1.0 / power.max(LEAST * largest)).collect();
        let lines: Vec<C> = inverse.iter().map(|inverse| C::from(*inverse)).collect();
        let kernel = plid_fourier::backward(&lines, x.len());
        let filtered: Vec<C> = bins.iter().zip(&inverse).map(|(bin, inverse)| *bin * *inverse).collect();
        let products = vec![plid_fourier::backward(&filtered, x.len())];
        let values = Bridge::new(&[missing.to_vec()], &[vec![kernel]]).values(&products);
        x.iter_mut().zip(&values[0]).for_each(|(x, value)| *x -= value);
    }
}
