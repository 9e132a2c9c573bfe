//! What the raw values show before any model: a coarse converter, a channel that repeats itself, a channel that clips.

use crate::record::Record;

/// A channel whose values lie on a grid this many times as coarse as the finest channel's is quantised.
const COARSER: f64 = 2.5;

/// Repeats of a value beyond chance: this many onsets at least.
const ONSETS: usize = 4;

/// What the codes of one output show.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Codes {
    /// Smallest distance between two values (V).
    pub step: f64,
    /// The converter is coarser than those of the other channels.
    pub coarse: bool,
    /// Onsets of repeats, per sample of the driven records.
    pub dropout_rate: Option<f64>,
    /// Of each record, the samples that repeat.
    pub repeats: Vec<Vec<usize>>,
}

/// Looks at every output.
pub fn codes(records: &[Record], sensor_std: &[f64]) -> Vec<Codes> {
    let p = records.first().map_or(0, |record| record.y.len());
    let steps: Vec<f64> = (0..p).map(|o| step(records, o)).collect();
    let finest = steps.iter().copied().filter(|s| *s > 0.0).fold(f64::INFINITY, f64::min);
    (0..p)
        .map(|o| {
            // With one channel, or all alike, the noise is the measure: it would blur a grid finer than itself.
            let noisy = sensor_std[o];
            let coarse = steps[o].is_finite()
                && (steps[o] > COARSER * finest && steps[o] > 1.5 * noisy || steps[o] > 4.0 * noisy);
            let repeats: Vec<Vec<usize>> = records.iter().map(|record| repeats(record, o, steps[o])).collect();
            let (mut onsets, mut samples) = (0, 0);
            for (record, repeats) in records.iter().zip(&repeats) {
                onsets += repeats.iter().enumerate().filter(|(k, at)| *k == 0 || repeats[k - 1] + 1 != **at).count();
                samples += record.samples();
            }
            let dropout_rate = (!coarse && onsets >= ONSETS).then(|| onsets as f64 / samples as f64);
            let repeats = if dropout_rate.is_some() { repeats } else { vec![Vec::new(); records.len()] };
            Codes { step: steps[o], coarse, dropout_rate, repeats }
        })
        .collect()
}

/// The grid on which values lie: the smallest distance between two different ones that occurs often.
fn step(records: &[Record], o: usize) -> f64 {
    let mut values: Vec<f64> = records.iter().flat_map(|r| r.y[o].iter().copied()).filter(|y| y.is_finite()).collect();
    values.sort_by(f64::total_cmp);
    let size = values.last().map_or(0.0, |last| last.abs().max(values[0].abs()));
    let distances = values.windows(2).map(|w| w[1] - w[0]).filter(|d| *d > 1e-5 * size);
    distances.fold(f64::INFINITY, f64::min)
}

/// Samples that belong to a run of three or more equal values while the signal moves by much more than the converter's step.
fn repeats(record: &Record, o: usize, step: f64) -> Vec<usize> {
    let y = &record.y[o];
    let moves = crate::record::rms(&y.windows(2).map(|w| w[1] - w[0]).collect::<Vec<f64>>());
    // Two equal neighbours happen by chance with this probability; three with its square.
    let chance = step / (2.0 * std::f64::consts::PI.sqrt() * moves.max(f64::MIN_POSITIVE));
    if !(chance < 0.03) {
        return Vec::new();
    }
    // At the rails a clipped converter repeats: that is no dropout.
    let (low, high) = y.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), y| (l.min(*y), h.max(*y)));
    let needed = if chance < 2e-3 { 2 } else { 3 };
    let mut found = Vec::new();
    let mut first = 0;
    for k in 1..=y.len() {
        if k < y.len() && y[k] == y[first] {
            continue;
        }
        if k - first >= needed && y[first] != low && y[first] != high {
            found.extend(first + 1..k);
        }
        first = k;
    }
    // Runs as long as chance makes them are chance.
    let expected = y.len() as f64 * chance.powi(needed as i32 - 1);
    let runs = found.iter().enumerate().filter(|(k, at)| *k == 0 || found[k - 1] + 1 != **at).count();
    if (runs as f64) > 3.0 * expected + 3.0 { found } else { Vec::new() }
}
