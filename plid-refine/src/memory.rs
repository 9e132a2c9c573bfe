//! The limit on the slowest pole.
//!
//! Under a periodic input, a pole whose time constant spans many periods affects a single line of the spectrum. At that
//! line it can reproduce any measured value, including noise and the nonlinearity of the structure, and a validation
//! segment that repeats the same periods cannot reveal this. Under a periodic input no time constant may therefore
//! exceed a quarter of the period: the impulse response then decays to e^-4, or 2 %, within a period, and the
//! half-power bandwidth of the pole, 1.3 times the line spacing, contains at least one line. If the input does not
//! repeat, the time constant may be as long as the record; anything slower cannot be distinguished from a trend. The
//! least restrictive record sets the limit.

use ndarray::ArrayView2;
use plid_fourier::sums_of_products;

use crate::record::Record;

/// Smallest number of time constants in a period.
const TIME_CONSTANTS: f64 = 4.0;
/// Smallest correlation of an input with itself one period later.
const REPEATS: f64 = 0.95;
/// The search for a period starts at the lag where the autocorrelation falls below this value.
const FORGOTTEN: f64 = 0.5;

/// Returns the period of the inputs in samples, if they repeat: the smallest lag at which the autocorrelation of every
/// input, after falling below 0.5, returns to at least 0.95.
pub fn period(inputs: ArrayView2<'_, f64>) -> Option<usize> {
    let samples = inputs.nrows();
    let channels: Vec<Vec<f64>> = inputs.columns().into_iter().filter_map(autocorrelation).collect();
    let smallest = |lag: usize| channels.iter().map(|c| c[lag]).fold(f64::INFINITY, f64::min);
    if channels.is_empty() {
        return None;
    }
    let half = samples / 2;
    let forgotten = (1..half).find(|&lag| smallest(lag) < FORGOTTEN)?;
    let first = (forgotten..half).find(|&lag| smallest(lag) >= REPEATS)?;
    // The lag of the maximum of that peak is the period.
    let mut top = first;
    while top + 1 < half && smallest(top + 1) > smallest(top) {
        top += 1;
    }
    Some(top)
}

/// Returns the autocorrelation of a channel at lags up to half its length, each over the overlapping samples, or `None`
/// for a channel of zeros.
fn autocorrelation(channel: ndarray::ArrayView1<'_, f64>) -> Option<Vec<f64>> {
    let samples = channel.len();
    let mut power = vec![0.0; samples + 1];
    for (k, x) in channel.iter().enumerate() {
        power[k + 1] = power[k] + x * x;
    }
    if !(power[samples] > 0.0) {
        return None;
    }
    let products = sums_of_products(&channel.to_vec());
    let lags = (0..samples.div_ceil(2).max(1)).map(|lag| {
        let (head, tail) = (power[samples - lag], power[samples] - power[lag]);
        let size_both = (head * tail).sqrt();
        if size_both > 0.0 { products[lag] / size_both } else { 0.0 }
    });
    Some(lags.collect())
}

/// Returns the largest permissible magnitude of a pole: exp(-1 / T), where T in samples is a quarter of the period of a
/// record or, if its inputs do not repeat, its length. The largest value over the records is returned.
pub fn slowest_radius(records: &[Record<'_>]) -> f64 {
    let longest = |r: &Record<'_>| period(r.inputs).map_or(r.samples() as f64, |p| p as f64 / TIME_CONSTANTS);
    (-1.0 / records.iter().map(longest).fold(1.0, f64::max)).exp()
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn noise(samples: usize, seed: u64) -> Vec<f64> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        (0..samples).map(|_| random.random::<f64>() - 0.5).collect()
    }

    #[test]
    fn a_period_is_found_and_noise_has_none() {
        let one = noise(200, 1);
        let repeated = Array2::from_shape_fn((900, 1), |(k, _)| one[k % 200]);
        assert_eq!(period(repeated.view()), Some(200));
        let random = Array2::from_shape_vec((900, 1), noise(900, 2)).unwrap();
        assert_eq!(period(random.view()), None);
        // Two inputs of periods 200 and 300 repeat together after 600 samples.
        let (a, b) = (noise(200, 3), noise(300, 4));
        let both = Array2::from_shape_fn((1500, 2), |(k, j)| if j == 0 { a[k % 200] } else { b[k % 300] });
        assert_eq!(period(both.view()), Some(600));
        // A slowly varying signal is similar to itself one sample later, but that is not a period.
        let slow = Array2::from_shape_fn((900, 1), |(k, _)| (0.003 * k as f64).sin());
        assert_eq!(period(slow.view()), None);
        let outputs = Array2::zeros((900, 1));
        let record =
            |inputs| Record { inputs, outputs: ndarray::ArrayView2::from(&outputs), start: Default::default() };
        assert_eq!(slowest_radius(&[record(repeated.view())]), (-1.0_f64 / 50.0).exp());
        assert_eq!(slowest_radius(&[record(repeated.view()), record(random.view())]), (-1.0_f64 / 900.0).exp());
    }
}
