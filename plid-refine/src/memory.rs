//! The limit on the slowest pole.
//!
//! A pole with a time constant of many periods of a periodic input answers at a single line of it: it is free to repeat, at that line, whatever was
//! measured there, noise and the structure's nonlinearity included, and a held-out stretch that repeats the same periods cannot punish it. So under
//! a periodic input no time constant may exceed a quarter of the period: within a period the answer to an impulse then dies to e^-4, 2 %, and the
//! pole's half-power band, 1.3 times as wide as the lines are apart, holds a line at least. Where the input does not repeat, the time constant may be as long
//! as the record; what is slower could not be told from a trend. The record that allows most decides.

use ndarray::ArrayView2;
use rustfft::FftPlanner;
use rustfft::num_complex::Complex64;

use crate::record::Record;

/// Time constants in a period, at least.
const TIME_CONSTANTS: f64 = 4.0;
/// Correlation of an input with itself a period later, at least.
const REPEATS: f64 = 0.95;
/// Below this the input has forgotten itself: a repeat is looked for behind it.
const FORGOTTEN: f64 = 0.5;

/// The period of the inputs in samples, if they repeat: the smallest lag at which every input's autocorrelation, having fallen below a half, returns to 0.95 and more.
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
    // The top of that peak.
    let mut top = first;
    while top + 1 < half && smallest(top + 1) > smallest(top) {
        top += 1;
    }
    Some(top)
}

/// Correlation of a channel with itself at lags up to half its length, each over the samples that overlap; None for a channel of zeros.
fn autocorrelation(channel: ndarray::ArrayView1<'_, f64>) -> Option<Vec<f64>> {
    let samples = channel.len();
    let mut power = vec![0.0; samples + 1];
    for (k, x) in channel.iter().enumerate() {
        power[k + 1] = power[k] + x * x;
    }
    if !(power[samples] > 0.0) {
        return None;
    }
    let size = (2 * samples).next_power_of_two();
    let mut planner = FftPlanner::new();
    let mut spectrum: Vec<Complex64> = channel.iter().map(|&x| Complex64::new(x, 0.0)).collect();
    spectrum.resize(size, Complex64::new(0.0, 0.0));
    planner.plan_fft_forward(size).process(&mut spectrum);
    spectrum.iter_mut().for_each(|z| *z = Complex64::new(z.norm_sqr(), 0.0));
    planner.plan_fft_inverse(size).process(&mut spectrum);
    let lags = (0..samples.div_ceil(2).max(1)).map(|lag| {
        let (head, tail) = (power[samples - lag], power[samples] - power[lag]);
        let size_both = (head * tail).sqrt();
        if size_both > 0.0 { spectrum[lag].re / size as f64 / size_both } else { 0.0 }
    });
    Some(lags.collect())
}

/// The largest magnitude of a pole that the records can tell: exp(-1 / T), where T, in samples, is a quarter of a record's period or, where its inputs do not
/// repeat, its length; the largest over the records.
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
        // Two inputs of periods 200 and 300 repeat after 600.
        let (a, b) = (noise(200, 3), noise(300, 4));
        let both = Array2::from_shape_fn((1500, 2), |(k, j)| if j == 0 { a[k % 200] } else { b[k % 300] });
        assert_eq!(period(both.view()), Some(600));
        // Slow signals are alike a sample later; that is no period.
        let slow = Array2::from_shape_fn((900, 1), |(k, _)| (0.003 * k as f64).sin());
        assert_eq!(period(slow.view()), None);
        let outputs = Array2::zeros((900, 1));
        let record =
            |inputs| Record { inputs, outputs: ndarray::ArrayView2::from(&outputs), start: Default::default() };
        assert_eq!(slowest_radius(&[record(repeated.view())]), (-1.0_f64 / 50.0).exp());
        assert_eq!(slowest_radius(&[record(repeated.view()), record(random.view())]), (-1.0_f64 / 900.0).exp());
    }
}
