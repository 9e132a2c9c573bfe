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
    let errors: Vec<Channels> = records.iter().zip(given).map(|(record, y)| record.error_where_measured(y)).collect();
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

/// Returns the sum of squares of the signal that no command explains, and its degrees of freedom. Missing samples (NaN)
/// are left out.
fn quiet(record: &Record, error: &[f64]) -> (f64, f64) {
    match record.excitation {
        Excitation::Zero => {
            let there: Vec<f64> = error.iter().copied().filter(|e| e.is_finite()).collect();
            let mean = there.iter().sum::<f64>() / there.len().max(1) as f64;
            (there.iter().map(|e| (e - mean).powi(2)).sum(), (there.len() as f64 - 1.0).max(0.0))
        }
        Excitation::Periodic(period) if error.len() >= 3 * period => {
            // The first period contains a transient.
            let differences = (period..error.len() - period).map(|k| error[k + period] - error[k]);
            let there = differences.filter(|difference| difference.is_finite());
            there.fold((0.0, 0.0), |(sum, count), difference| (sum + 0.5 * difference.powi(2), count + 1.0))
        }
        _ => (0.0, 0.0),
    }
}

/// Returns the standard deviation of white noise that has the power of the upper end of the band; NaN if all samples
/// are missing.
fn upper(error: &[f64]) -> f64 {
    let length = plid_fourier::good_length_below(error.len());
    // Hann's window keeps the low frequencies out of the upper end.
    let window = |k: usize| (std::f64::consts::PI * (k as f64 + 0.5) / length as f64).sin().powi(2);
    let error = &error[..length];
    let tapered: Vec<f64> = bridged(error).iter().enumerate().map(|(k, e)| e * window(k)).collect();
    let bins = plid_fourier::forward(&tapered);
    let from = ((1.0 - UPPER) * bins.len() as f64) as usize;
    let power = bins[from..].iter().map(|z| z.norm_sqr()).sum::<f64>() / (bins.len() - from).max(1) as f64;
    // A line across missing samples has no power there.
    let measured: f64 = (0..length).filter(|&k| error[k].is_finite()).map(|k| window(k).powi(2)).sum();
    (power / measured).sqrt()
}

/// Returns a channel in which missing samples (NaN) lie on a straight line between their neighbours, so that the ends
/// of a gap are no steps.
fn bridged(x: &[f64]) -> Vec<f64> {
    let there: Vec<usize> = (0..x.len()).filter(|&k| x[k].is_finite()).collect();
    let mut bridged = x.to_vec();
    for ends in there.windows(2) {
        let [from, to] = [ends[0], ends[1]];
        let slope = (x[to] - x[from]) / (to - from) as f64;
        (from + 1..to).for_each(|k| bridged[k] = x[from] + slope * (k - from) as f64);
    }
    if let (Some(&first), Some(&last)) = (there.first(), there.last()) {
        bridged[..first].fill(x[first]);
        bridged[last..].fill(x[last]);
    }
    bridged
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
            // Missing samples change nothing. The slow signal vanishes at both ends of the first gap, but not of the
            // second one.
            for gap in [0..0, 2827..3456, 2700..2900] {
                let mut record = record.clone();
                record.y[0][gap.clone()].fill(f64::NAN);
                let found = estimate(&[record], &zero);
                assert!((found.std[0] / 0.1 - 1.0).abs() < 0.06 && found.seen == seen, "{gap:?}: {:?}", found.std);
            }
        }
    }
}
