//! The noise level of records, estimated without a model of the simulator.

use crate::case::record::{Channels, Excitation, Record, rms};

/// Share of the band, at its upper end, whose power counts as noise if the noise is not known otherwise.
const UPPER: f64 = 0.25;

/// The noise of each output, and whether the records show it directly.
pub(super) struct Noise {
    /// Standard deviation of each output (p).
    pub std: Vec<f64>,
    /// Whether the noise follows from quiet records or from repeats of an input.
    pub seen: bool,
}

impl Noise {
    /// Returns the warning for records that do not show the noise.
    pub fn warning(&self) -> Option<String> {
        let text = "no record without input and no repeated input shows the noise: it is estimated from the highest \
                    frequencies of the gap";
        (!self.seen).then(|| text.into())
    }
}

/// Estimates the noise from records without input and from the differences between periods, or otherwise from the
/// highest frequencies of the gap, which give an upper bound.
pub(super) fn estimate(records: &[Record], given: &[Channels]) -> Noise {
    let errors: Vec<Channels> = records.iter().zip(given).map(|(record, y)| record.error(y)).collect();
    let p = records.first().map_or(0, |record| record.y.len());
    let of = |o: usize| -> (f64, bool) {
        let mut squares = (0.0, 0.0);
        for (record, error) in records.iter().zip(&errors) {
            let (sum, count) = quiet(record, &error[o]);
            squares = (squares.0 + sum, squares.1 + count);
        }
        if squares.1 > 0.0 {
            return ((squares.0 / squares.1).sqrt(), true);
        }
        let all: Vec<f64> = errors.iter().map(|error| upper(&error[o])).collect();
        (all.into_iter().fold(f64::INFINITY, f64::min), false)
    };
    let all: Vec<(f64, bool)> = (0..p).map(of).collect();
    // A record that repeats to the last digit has no noise but that of rounding.
    let least = |o: usize| 1e-6 * rms(records.iter().flat_map(|r| r.y[o].iter().filter(|y| y.is_finite())));
    Noise {
        std: all.iter().enumerate().map(|(o, (std, _))| std.max(least(o)).max(f64::MIN_POSITIVE)).collect(),
        seen: all.iter().all(|(_, seen)| *seen),
    }
}

/// Returns the sum of squares of the signal that no command explains, and its degrees of freedom.
fn quiet(record: &Record, error: &[f64]) -> (f64, f64) {
    match record.excitation {
        Excitation::Zero => {
            let mean = error.iter().sum::<f64>() / error.len().max(1) as f64;
            (error.iter().map(|e| (e - mean).powi(2)).sum(), error.len() as f64 - 1.0)
        }
        Excitation::Periodic(period) if error.len() >= 3 * period => {
            // The first period contains a transient.
            let pairs = period..error.len() - period;
            let sum: f64 = pairs.clone().map(|k| 0.5 * (error[k + period] - error[k]).powi(2)).sum();
            (sum, pairs.len() as f64)
        }
        _ => (0.0, 0.0),
    }
}

/// Returns the standard deviation of white noise that has the power of the upper end of the band.
fn upper(error: &[f64]) -> f64 {
    let length = plid_fourier::good_length_below(error.len());
    // Hann's window keeps the low frequencies out of the upper end.
    let window = |k: usize| (std::f64::consts::PI * (k as f64 + 0.5) / length as f64).sin().powi(2);
    let tapered: Vec<f64> = error[..length].iter().enumerate().map(|(k, e)| e * window(k)).collect();
    let bins = plid_fourier::forward(&tapered);
    let from = ((1.0 - UPPER) * bins.len() as f64) as usize;
    let power = bins[from..].iter().map(|z| z.norm_sqr()).sum::<f64>() / (bins.len() - from).max(1) as f64;
    // The squares of the window have a mean of 3/8.
    (power / (0.375 * length as f64)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{random_input, record};

    #[test]
    fn each_kind_of_record_shows_the_noise() {
        let noise = random_input(5, 6000, 1).remove(0);
        let slow = |k: usize| 3.0 * (0.01 * k as f64).sin();
        let y = |slow: &dyn Fn(usize) -> f64| vec![(0..6000).map(|k| slow(k) + 0.1 * noise[k]).collect::<Vec<f64>>()];
        let u = random_input(6, 6000, 1);
        let zero = vec![vec![vec![0.0; 6000]]];
        let quiet = Record { excitation: Excitation::Zero, ..record(vec![vec![0.0; 6000]], y(&|_| 0.2)) };
        let repeats = |k: usize| slow(k % 500);
        let periodic = Record { excitation: Excitation::Periodic(500), ..record(u.clone(), y(&repeats)) };
        let random = record(u, y(&slow));
        for (record, seen) in [(quiet, true), (periodic, true), (random, false)] {
            let found = estimate(&[record], &zero);
            assert!((found.std[0] / 0.1 - 1.0).abs() < 0.06 && found.seen == seen, "{:?}", found.std);
        }
    }
}
