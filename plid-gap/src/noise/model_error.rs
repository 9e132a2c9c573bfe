//! The error of a surrogate model on the records from which it was identified. This error grows with the level, and
//! an effect must exceed it.
//!
//! In a periodic record, the error is the periodic part of the residual. In any other record, it is the part that a
//! linear filter reproduces from the inputs (Bendat and Piersol 2010, 7.3: coherent output power); the remainder is
//! noise.

use nalgebra::{DMatrix, DVector};

use crate::case::record::{Channels, Excitation, Record};
use plid_fourier::C;

/// Spectral density of the error at the level of the records in which it was found.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelError {
    /// RMS of the inputs of those records.
    level: f64,
    /// Distance in Hz between adjacent values.
    step: f64,
    /// For each output, the density from zero frequency on, as the variance of white noise of the same density.
    density: Vec<Vec<f64>>,
}

/// Smallest number of segments for each input. The bias of the coherence is then below one eighth.
const SEGMENTS: usize = 8;

/// Longest and shortest segment in samples, with which the lines of lightly damped modes are resolved, or at least
/// separated.
const LENGTHS: [usize; 2] = [2048, 128];

/// Number of lines on either side over which a density is averaged.
const SMOOTHED: usize = 2;

/// Smallest number of frequency bins of the longest record that are averaged into one value of the density.
const CELL: usize = 4;

/// Largest number of values of the density.
const MOST_CELLS: usize = 1024;

impl ModelError {
    /// Estimates the error from a record and the residual of the model (p channels). Returns `None` if the record is
    /// not driven or is too short.
    pub fn of(record: &Record, error: &[Vec<f64>], rate: f64) -> Option<Self> {
        let (step, density) = match record.excitation {
            Excitation::Zero => return None,
            Excitation::Periodic(period) => (rate / period as f64, repeating(error, period)?),
            Excitation::Random => coherent(&record.u, error, rate)?,
        };
        Some(Self { level: record.level(), step, density: density.iter().map(|d| smoothed(d)).collect() })
    }

    /// Estimates the residual of an explanation in driven records in excess of the noise. `errors` contains p
    /// channels for each record; `noise` gives the density of each output's noise at a frequency. The density is
    /// assumed to grow with the square of the level and is fitted to all levels by least squares. Returns `None` if
    /// no record is driven.
    pub fn left(records: &[Record], errors: &[Channels], noise: impl Fn(f64) -> Vec<f64>, rate: f64) -> Option<Self> {
        let driven = || records.iter().zip(errors).filter(|(record, _)| record.is_driven());
        let level = driven().map(|(record, _)| record.level()).fold(0.0, f64::max);
        let longest = driven().map(|(record, _)| record.samples()).max()?;
        let cells = (longest / (2 * CELL)).clamp(1, MOST_CELLS);
        let step = 0.5 * rate / cells as f64;
        let p = records[0].y.len();
        // Sums over the records: the power beyond the noise times the squared level, and the fourth power of the
        // level.
        let (mut power, mut weight) = (vec![vec![0.0; cells + 1]; p], vec![0.0; cells + 1]);
        let quiet: Vec<Vec<f64>> = (0..=cells).map(|cell| noise(cell as f64 * step)).collect();
        for (record, error) in driven() {
            let square = (record.level() / level).powi(2);
            let length = plid_fourier::good_length_below(record.samples());
            let spectra: Vec<Vec<C>> = error.iter().map(|e| plid_fourier::forward(&e[..length])).collect();
            for k in 0..=length / 2 {
                let cell = (k as f64 * rate / length as f64 / step).round() as usize;
                weight[cell] += square * square;
                for (o, spectrum) in spectra.iter().enumerate() {
                    power[o][cell] += square * (spectrum[k].norm_sqr() / length as f64 - quiet[cell][o]);
                }
            }
        }
        let of = |power: &Vec<f64>| -> Vec<f64> {
            let around = |values: &[f64], k: usize| -> f64 {
                values[k.saturating_sub(SMOOTHED)..(k + SMOOTHED + 1).min(values.len())].iter().sum()
            };
            (0..=cells).map(|k| (around(power, k) / around(&weight, k).max(f64::MIN_POSITIVE)).max(0.0)).collect()
        };
        Some(Self { level, step, density: power.iter().map(of).collect() })
    }

    /// Returns the density of an output at a frequency, in a record of this level.
    pub fn density(&self, output: usize, hz: f64, level: f64) -> f64 {
        let values = &self.density[output];
        let at = (hz / self.step).clamp(0.0, (values.len() - 1) as f64);
        let (from, share) = (at.floor() as usize, at.fract());
        let value = values[from] * (1.0 - share) + values[(from + 1).min(values.len() - 1)] * share;
        value * (level / self.level).powi(2)
    }
}

/// Returns the density of the mean over all periods but the first, which contains a transient.
fn repeating(error: &[Vec<f64>], period: usize) -> Option<Vec<Vec<f64>>> {
    let periods = error[0].len() / period;
    if periods < 2 {
        return None;
    }
    let of = |e: &Vec<f64>| -> Vec<f64> {
        let mean: Vec<f64> =
            (0..period).map(|k| (1..periods).map(|j| e[j * period + k]).sum::<f64>() / (periods - 1) as f64).collect();
        plid_fourier::forward(&mean).iter().map(|z| z.norm_sqr() / period as f64).collect()
    };
    Some(error.iter().map(of).collect())
}

/// Returns the density of the part that a linear filter reproduces from the inputs, by least squares over segments at
/// each frequency.
fn coherent(u: &[Vec<f64>], error: &[Vec<f64>], rate: f64) -> Option<(f64, Vec<Vec<f64>>)> {
    let (samples, m) = (error[0].len(), u.len());
    let length = (2 * samples / (SEGMENTS * m + 1)).min(LENGTHS[0]);
    if length < LENGTHS[1] {
        return None;
    }
    let length = plid_fourier::good_length_below(length);
    let starts: Vec<usize> = (0..).map(|k| k * length / 2).take_while(|at| at + length <= samples).collect();
    let window: Vec<f64> =
        (0..length).map(|k| (std::f64::consts::PI * (k as f64 + 0.5) / length as f64).sin().powi(2)).collect();
    let power: f64 = window.iter().map(|w| w * w).sum();
    let bins = |x: &[f64]| -> Vec<Vec<C>> {
        let one = |at: &usize| {
            let part: Vec<f64> = x[*at..at + length].iter().zip(&window).map(|(x, w)| x * w).collect();
            plid_fourier::forward(&part)
        };
        starts.iter().map(one).collect()
    };
    let inputs: Channels = u.to_vec();
    let inputs: Vec<Vec<Vec<C>>> = inputs.iter().map(|u| bins(u)).collect();
    // Half-overlapping Hann segments are not independent: they count as 0.8 of their number.
    let free = 0.8 * starts.len() as f64;
    let spread = free / (free - m as f64).max(1.0);
    let of = |e: &Vec<f64>| -> Vec<f64> {
        let e = bins(e);
        (0..=length / 2)
            .map(|k| {
                let a = DMatrix::from_fn(starts.len(), m, |s, i| inputs[i][s][k]);
                let b = DVector::from_fn(starts.len(), |s, _| e[s][k]);
                let whole = b.norm_squared();
                let Some(factor) = (a.adjoint() * &a).cholesky() else { return 0.0 };
                let left = (&b - &a * factor.solve(&(a.adjoint() * &b))).norm_squared();
                (whole - spread * left).max(0.0) / (starts.len() as f64 * power)
            })
            .collect()
    };
    Some((rate / length as f64, error.iter().map(of).collect()))
}

fn smoothed(density: &[f64]) -> Vec<f64> {
    (0..density.len())
        .map(|k| {
            let part = &density[k.saturating_sub(SMOOTHED)..(k + SMOOTHED + 1).min(density.len())];
            part.iter().sum::<f64>() / part.len() as f64
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::random_input;

    fn record(excitation: Excitation, u: Channels, y: Channels) -> Record {
        Record { name: "r".into(), excitation, from_rest: true, start_s: 0.0, held_out: false, u, y, simulated: None }
    }

    #[test]
    fn of_a_random_record_it_is_what_the_inputs_give() {
        let u = random_input(1, 16384, 2);
        let noise = random_input(2, 16384, 1);
        // A tenth of the second input, plus noise five times as large.
        let error = vec![u[1].iter().zip(&noise[0]).map(|(u, e)| 0.1 * u + 0.5 * e).collect::<Vec<f64>>()];
        let level = crate::case::record::rms(u.iter().flatten());
        let model_error = ModelError::of(&record(Excitation::Random, u, error.clone()), &error, 100.0).unwrap();
        let mean: f64 = (1..50).map(|hz| model_error.density(0, f64::from(hz), level)).sum::<f64>() / 49.0;
        // The white input has variance one, so the density is 0.01, and the scatter of the noise adds to it.
        assert!((0.008..0.03).contains(&mean), "{mean}");
        let louder: f64 = model_error.density(0, 10.0, 3.0 * level) / model_error.density(0, 10.0, level);
        assert!((louder - 9.0).abs() < 1e-9);
    }

    #[test]
    fn of_a_periodic_record_it_is_what_repeats() {
        let period = 200;
        let one = random_input(3, period, 1).remove(0);
        let noise = random_input(4, 40 * period, 1).remove(0);
        let error = vec![(0..40 * period).map(|k| one[k % period] + 0.5 * noise[k]).collect::<Vec<f64>>()];
        let u = random_input(5, 40 * period, 1);
        let level = crate::case::record::rms(u.iter().flatten());
        let model_error =
            ModelError::of(&record(Excitation::Periodic(period), u, error.clone()), &error, 100.0).unwrap();
        let mean: f64 = (1..50).map(|hz| model_error.density(0, f64::from(hz), level)).sum::<f64>() / 49.0;
        let power = one.iter().map(|x| x * x).sum::<f64>() / period as f64;
        assert!((mean / power - 1.0).abs() < 0.1, "{mean} {power}");
    }

    /// The error is a twentieth of the input plus noise, at two levels. The noise is not counted, and the quieter
    /// record has a quarter of the power.
    #[test]
    fn what_an_explanation_leaves_grows_with_the_level() {
        let one = |seed: u64, level: f64| {
            let u = random_input(seed, 8192, 1);
            let noise = random_input(seed + 1, 8192, 1);
            let u: Channels = vec![u[0].iter().map(|u| level * u).collect()];
            let error: Channels = vec![u[0].iter().zip(&noise[0]).map(|(u, e)| 0.05 * u + 0.02 * e).collect()];
            (record(Excitation::Random, u, error.clone()), error)
        };
        let (records, errors): (Vec<Record>, Vec<Channels>) = [one(11, 1.0), one(13, 0.5)].into_iter().unzip();
        let left = ModelError::left(&records, &errors, |_| vec![4e-4], 100.0).unwrap();
        let mean = |level: f64| (1..50).map(|hz| left.density(0, f64::from(hz), level)).sum::<f64>() / 49.0;
        let level = records[0].level();
        assert!((mean(level) / 25e-4 - 1.0).abs() < 0.1, "{}", mean(level));
        assert!((mean(level) / mean(0.5 * level) - 4.0).abs() < 1e-9);
    }

    #[test]
    fn a_short_record_tells_nothing() {
        let u = random_input(1, 400, 2);
        assert_eq!(ModelError::of(&record(Excitation::Random, u.clone(), u.clone()), &u, 100.0), None);
    }
}
