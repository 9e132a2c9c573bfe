//! Properties of the raw values that are found without a model: coarse converters, repeated values and clipping.

use std::collections::BTreeMap;

use plid_model::signal::mean;
use statrs::distribution::{ContinuousCDF, Normal};

use crate::case::record::{Channels, Excitation, Record, rms};
use crate::settings::SignalSettings;

/// Relative error of values in a file of six digits.
const DIGITS: f64 = 1e-6;

/// Smallest and largest distance from the grid, in steps, that may be due to the digits of a file.
const OFF_GRID: [f64; 2] = [0.01, 0.1];

/// Number of samples on each side with whose errors the error of a repeated value is compared: enough for a median, and
/// few enough for the level to be the same.
const NEIGHBOURS: usize = 60;

/// Quantisation and dropouts of one output.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Quantisation {
    /// Smallest distance between two values (V).
    pub step: f64,
    /// Whether all values differ by multiples of the step.
    pub grid: bool,
    /// Whether the converter is coarser than those of the other channels.
    pub coarse: bool,
    /// Variance of the noise before the converter (V^2), if the values lie on a grid and have only a few codes in the
    /// records without input. The variance of these codes is then not that of a moving signal.
    pub hidden: Option<f64>,
    /// Whether the converter truncates towards zero instead of rounding.
    pub cut: bool,
    /// Number of runs of repeated values per sample of the driven records, if the output drops samples.
    pub dropout_rate: Option<f64>,
    /// For each record, the samples that are repeated.
    pub repeats: Vec<Vec<usize>>,
}

impl Quantisation {
    /// Returns whether the error of rounding is large and can be predicted from the value before the converter.
    pub fn rounds(&self) -> bool {
        self.coarse && self.grid && !self.cut
    }
}

/// Examines every output. `errors` are those of the simulation as given (p channels for each record).
pub fn of_outputs(
    records: &[Record],
    errors: &[Channels],
    sensor_std: &[f64],
    settings: &SignalSettings,
) -> Vec<Quantisation> {
    let SignalSettings { coarse_step, coarse_over_noise, coarse_alone, .. } = *settings;
    let p = records.first().map_or(0, |record| record.y.len());
    let steps: Vec<f64> = (0..p).map(|o| step(records, o)).collect();
    let finest = steps.iter().copied().filter(|s| *s > 0.0).fold(f64::INFINITY, f64::min);
    (0..p)
        .map(|o| {
            // The noise is the reference for a single channel, or if all channels are alike, because it would blur a
            // finer grid. A sensor may be much noisier than declared.
            let noisy = sensor_std[o].max(at_rest(records, o, steps[o]));
            let coarse = steps[o].is_finite()
                && (steps[o] > coarse_step * finest && steps[o] > coarse_over_noise * noisy
                    || steps[o] > coarse_alone * noisy);
            let jumps: Vec<Jumps> =
                records.iter().zip(errors).map(|(r, e)| jumps(&r.y[o], &e[o], sensor_std[o], settings)).collect();
            let (mut onsets, mut others, mut samples) = (0, 0, 0);
            // While nothing moves, a repeated value cannot be recognised.
            for (record, jumps) in records.iter().zip(&jumps).filter(|(record, _)| driven(record)) {
                let repeats = &jumps.repeats;
                onsets += repeats.iter().enumerate().filter(|(k, at)| *k == 0 || repeats[k - 1] + 1 != **at).count();
                others += jumps.others;
                samples += record.samples();
            }
            let drops = !coarse && onsets >= settings.dropouts && onsets >= others;
            let dropout_rate = drops.then(|| onsets as f64 / samples as f64);
            let repeats = jumps.into_iter().map(|jumps| if drops { jumps.repeated() } else { Vec::new() }).collect();
            let cut = coarse && cuts(records, o, steps[o], settings.truncation_values);
            let grid = on_grid(records, o, steps[o]);
            let hidden = if grid { hidden(records, o, steps[o]) } else { None };
            Quantisation { step: steps[o], grid, coarse, hidden, cut, dropout_rate, repeats }
        })
        .collect()
}

/// Returns the standard deviation of an output in the records without input, less the contribution of rounding to this
/// step; zero if there is no such record.
fn at_rest(records: &[Record], o: usize, step: f64) -> f64 {
    let quiet = records.iter().filter(|record| !driven(record));
    let values: Vec<f64> = quiet.flat_map(|record| record.y[o].iter().copied()).collect();
    let mean = mean(&values);
    let std = rms(values.iter().map(|y| y - mean));
    (std * std - step * step / 12.0).max(0.0).sqrt()
}

/// Returns the variance of Gaussian noise before a converter if its standard deviation is smaller than half a step. The
/// estimate uses the numbers of values above and below the most frequent code in the records without input. `None` if
/// there is no such record, or if all values have that code.
fn hidden(records: &[Record], o: usize, step: f64) -> Option<f64> {
    let quiet = records.iter().filter(|record| !driven(record));
    let values: Vec<f64> = quiet.flat_map(|record| &record.y[o]).copied().filter(|y| y.is_finite()).collect();
    let first = *values.first()?;
    let mut counts: BTreeMap<i64, usize> = BTreeMap::new();
    values.iter().for_each(|y| *counts.entry(((y - first) / step).round() as i64).or_default() += 1);
    let most = counts.iter().max_by_key(|(_, count)| **count).map(|(&code, _)| code)?;
    let above: usize = counts.range(most + 1..).map(|(_, count)| count).sum();
    let below: usize = counts.range(..most).map(|(_, count)| count).sum();
    if above + below == 0 {
        return None;
    }
    // Distances from the mean to the edges of the code, in standard deviations. If no value lies beyond an edge, half a
    // value is assumed there.
    let edge = |beyond: usize| {
        let beyond = if beyond == 0 { 0.5 } else { beyond as f64 };
        -Normal::standard().inverse_cdf(beyond / values.len() as f64)
    };
    let width = edge(above) + edge(below);
    (width > 2.0).then(|| (step / width).powi(2))
}

/// Returns whether a converter truncates: its code zero is then twice as wide as the others. The likelihoods of the
/// codes of a Gaussian signal are compared for truncation and for rounding, each with the size of the signal that suits
/// a random record best. At least `least` values must lie in the two codes next to zero. Values at rest, before the
/// motion begins or while friction holds a part, do not count.
fn cuts(records: &[Record], o: usize, step: f64, least: f64) -> bool {
    let (mut next, mut gain) = (0, 0.0);
    for record in records.iter().filter(|record| record.excitation == Excitation::Random) {
        let mut counts: BTreeMap<u64, usize> = BTreeMap::new();
        let finite = record.y[o].iter().filter(|y| y.is_finite());
        let codes: Vec<u64> = finite.map(|y| (y.abs() / step).round() as u64).collect();
        let runs = || codes.chunk_by(|a, b| a == b);
        let longest = runs().filter(|run| run[0] != 0).map(<[u64]>::len).max().unwrap_or(0);
        let moving = runs().filter(|run| run[0] != 0 || run.len() <= AT_REST * longest);
        moving.for_each(|run| *counts.entry(run[0]).or_default() += run.len());
        next += counts.get(&1).copied().unwrap_or(0);
        gain += likelihood(&counts, 1.0) - likelihood(&counts, 0.5);
    }
    next as f64 >= least && gain > 0.0
}

/// Returns the log likelihood of the magnitudes of the codes of a Gaussian signal of the most likely size. The code
/// zero ends at `edge` (in steps), and each further code is one step wide.
fn likelihood(counts: &BTreeMap<u64, usize>, edge: f64) -> f64 {
    let normal = Normal::standard();
    let square = counts.iter().map(|(code, count)| (*code as f64).powi(2) * *count as f64).sum::<f64>();
    let size = (square / counts.values().sum::<usize>() as f64).sqrt();
    let of_size = |size: f64| -> f64 {
        let beyond = |edge: f64| 2.0 * normal.sf(edge / size);
        let code = |code: u64| match code {
            0 => 1.0 - beyond(edge),
            code => beyond(code as f64 - 1.0 + edge) - beyond(code as f64 + edge),
        };
        counts.iter().map(|(of, count)| *count as f64 * code(*of).max(f64::MIN_POSITIVE).ln()).sum()
    };
    let sizes = (0..SIZES).map(|k| size * SIZE_RANGE.powf(2.0 * k as f64 / (SIZES - 1) as f64 - 1.0));
    sizes.map(of_size).fold(f64::NEG_INFINITY, f64::max)
}

/// Ratio of a run of zeros to the longest run of another code beyond which nothing moves: a signal passes zero faster
/// than its peaks.
const AT_REST: usize = 2;

/// Number of sizes of a signal that are tried.
const SIZES: usize = 101;

/// Largest ratio, in either direction, between a size that is tried and the RMS of the codes.
const SIZE_RANGE: f64 = 4.0;

/// Adds half a step to the magnitude of truncated values. A value in the code zero gets the sign of the simulated
/// value, which is the value minus the entry of `errors`.
pub fn mend(records: &mut [Record], errors: &[Channels], quantisation: &[Quantisation]) {
    for (record, errors) in records.iter_mut().zip(errors) {
        let outputs = record.y.iter_mut().zip(errors).zip(quantisation);
        for ((y, error), output) in outputs.filter(|(_, output)| output.cut) {
            for (y, error) in y.iter_mut().zip(error) {
                let sign = if *y == 0.0 { -error } else { *y };
                if sign != 0.0 {
                    *y += (0.5 * output.step).copysign(sign);
                }
            }
        }
    }
}

/// Number of harmonics in the series of the expected error of rounding.
const HARMONICS: usize = 40;

/// Subtracts the expected error of rounding from the values of coarse converters that round. `simulated` are free runs,
/// one for each record. Their distance from the values before the converter follows from their errors. All codes may
/// have the same offset from the multiples of the step.
pub fn unround(records: &mut [Record], simulated: &[Channels], quantisation: &[Quantisation]) {
    for (record, simulated) in records.iter_mut().zip(simulated).filter(|(record, _)| driven(record)) {
        let outputs = record.y.iter_mut().zip(simulated).zip(quantisation);
        for ((y, simulated), output) in outputs.filter(|(_, output)| output.rounds()) {
            let step = output.step;
            let Some(off) = y.iter().find(|y| y.is_finite()).map(|y| y - (y / step).round() * step) else { continue };
            let error = rms(y.iter().zip(simulated).map(|(y, simulated)| y - simulated));
            let spread = (error * error - step * step / 12.0).max(0.0).sqrt() / step;
            for (y, simulated) in y.iter_mut().zip(simulated) {
                *y -= step * expected_rounding((simulated - off) / step, spread);
            }
        }
    }
}

/// Returns the expected error of rounding a Gaussian value with this mean and standard deviation to an integer: the
/// Fourier series of a sawtooth, smoothed by the distribution.
fn expected_rounding(mean: f64, std: f64) -> f64 {
    let harmonic = |k: usize| {
        let turns = 2.0 * std::f64::consts::PI * k as f64;
        let sign = if k.is_multiple_of(2) { 2.0 } else { -2.0 };
        sign / turns * (turns * mean).sin() * (-0.5 * (turns * std).powi(2)).exp()
    };
    (1..=HARMONICS).map(harmonic).sum()
}

/// Returns whether a repeated value could be recognised in a record.
pub(crate) fn driven(record: &Record) -> bool {
    record.excitation != Excitation::Zero
}

/// Returns the step of the grid of values, which is the smallest distance between two different values that exceeds
/// rounding.
fn step(records: &[Record], o: usize) -> f64 {
    let mut values: Vec<f64> = records.iter().flat_map(|r| r.y[o].iter().copied()).filter(|y| y.is_finite()).collect();
    values.sort_by(f64::total_cmp);
    let size = values.last().map_or(0.0, |last| last.abs().max(values[0].abs()));
    let distances = values.windows(2).map(|w| w[1] - w[0]).filter(|d| *d > 1e-5 * size);
    distances.fold(f64::INFINITY, f64::min)
}

/// Returns whether all values differ by multiples of a step, up to the digits of a file.
fn on_grid(records: &[Record], o: usize, step: f64) -> bool {
    let mut values = records.iter().flat_map(|record| &record.y[o]).filter(|y| y.is_finite());
    let Some(first) = values.next().filter(|_| step.is_finite()) else { return false };
    values.all(|y| {
        let steps = (y - first) / step;
        (steps - steps.round()).abs() < (DIGITS * steps.abs()).clamp(OFF_GRID[0], OFF_GRID[1])
    })
}

/// Samples at which an output departs from the simulation and returns to it.
struct Jumps {
    /// Samples that repeat the value before them.
    repeats: Vec<usize>,
    /// Repeated values near an extreme, while the simulation lies further out. A converter that clips also causes them,
    /// so they count only if the output drops samples elsewhere.
    held_down: Vec<usize>,
    /// Number of single samples that depart from the simulation and repeat no value. If they outnumber the repeated
    /// values, they have another cause, such as heavy-tailed noise, and some pairs of equal values are due to chance.
    others: usize,
}

impl Jumps {
    /// Returns the repeated samples of an output that drops samples.
    fn repeated(self) -> Vec<usize> {
        let mut all = [self.repeats, self.held_down].concat();
        all.sort_unstable();
        all
    }
}

/// Returns the samples that are repeated in a record of an output that drops samples. `error` is that of a simulation,
/// and `noise` the standard deviation of the sensor's noise.
pub(crate) fn repeats(y: &[f64], error: &[f64], noise: f64, settings: &SignalSettings) -> Vec<usize> {
    jumps(y, error, noise, settings).repeated()
}

/// Finds the samples that repeat the value before them while the simulation moves away. Two values may be equal by
/// chance, but their error is then as small as elsewhere.
fn jumps(y: &[f64], error: &[f64], noise: f64, settings: &SignalSettings) -> Jumps {
    let SignalSettings { near_extreme, repeat_error, repeat_over_median, repeat_isolation, .. } = *settings;
    let (low, high) = y.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), y| (l.min(*y), h.max(*y)));
    // A comparison with a missing sample (NaN) is false.
    let (middle, reach) = (0.5 * (low + high), 0.5 * (high - low));
    let extreme = |y: f64| (y - middle).abs() >= near_extreme * reach;
    let rail = y.iter().filter(|y| extreme(**y)).count() as f64 > settings.clipped_share * y.len() as f64;
    let mut found = Jumps { repeats: Vec::new(), held_down: Vec::new(), others: 0 };
    let mut first = 0;
    for k in 1..=y.len() {
        if k < y.len() && y[k] == y[first] {
            continue;
        }
        let most = |from: usize| error[from..k].iter().fold(0.0, |most: f64, e| most.max(e.abs()));
        // A dropout begins abruptly. Two values are also equal near the peak of a slow error.
        let calm = |from: usize| {
            let small = |at: Option<usize>| {
                at.and_then(|k| error.get(k)).is_none_or(|e| e.abs() < repeat_isolation * most(from))
            };
            small(from.checked_sub(1)) && small(Some(k))
        };
        let single = k - first == 1;
        // A converter that clips also repeats values while the simulation lies further out. This is not a dropout.
        let worst = (first..k).max_by(|a, b| error[*a].abs().total_cmp(&error[*b].abs())).unwrap_or(first);
        let held_down = extreme(y[first]) && error[worst] * (y[first] - middle) < 0.0;
        if most(first) > repeat_error * noise && !(held_down && (rail || single)) && (!single || calm(first)) {
            let around = first.saturating_sub(NEIGHBOURS)..(k + NEIGHBOURS).min(error.len());
            let mut near: Vec<f64> = error[around].iter().map(|e| e.abs()).collect();
            near.sort_by(f64::total_cmp);
            let out = |e: f64| e > repeat_error * noise && e > repeat_over_median * near[near.len() / 2];
            // Most converters hold the last good value. If another value replaces it, the first sample of the run is
            // also wrong.
            let from = first + usize::from(!single && !out(error[first].abs()));
            if out(most(from)) && calm(from) {
                match (single, held_down) {
                    (true, _) => found.others += 1,
                    (false, true) => found.held_down.extend(from..k),
                    (false, false) => found.repeats.extend(from..k),
                }
            }
        }
        first = k;
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;

    fn record(y: Channels) -> Record {
        testing::record(Vec::new(), y)
    }

    /// Held values of a smooth signal on a grid are found, even at its largest value. The values that a clipping
    /// converter holds are not found.
    #[test]
    fn what_drops_out_at_a_peak_is_seen_and_what_is_clipped_is_not() {
        let white = testing::random_input(8, 3000, 1).remove(0);
        let mut smooth = vec![0.0; white.len()];
        for k in 2..white.len() {
            smooth[k] = 1.7 * smooth[k - 1] - 0.95 * smooth[k - 2] + 0.2 * white[k];
        }
        let on_grid = |y: &f64| (y / 0.005).round() * 0.005;
        let peak = (0..smooth.len()).max_by(|a, b| smooth[*a].abs().total_cmp(&smooth[*b].abs())).unwrap();
        let mut held: Vec<f64> = smooth.iter().map(on_grid).collect();
        let starts = [100, 400, 700, 1000, 1300, 1600, peak];
        for start in starts {
            (start + 1..start + 5).for_each(|k| held[k] = held[start]);
        }
        let errors = |y: &[f64]| vec![vec![y.iter().zip(&smooth).map(|(y, s)| y - s).collect::<Vec<f64>>()]];
        let settings = SignalSettings::default();
        let found = of_outputs(&[record(vec![held.clone()])], &errors(&held), &[0.005], &settings).remove(0);
        assert!(found.dropout_rate.is_some());
        let mut wanted: Vec<usize> = starts.iter().flat_map(|start| start + 1..start + 5).collect();
        wanted.sort_unstable();
        // A value is not wrong if the signal meanwhile changed by no more than the noise.
        let wrong: Vec<usize> = wanted.iter().copied().filter(|k| (held[*k] - smooth[*k]).abs() > 0.1).collect();
        assert!(wrong.iter().all(|k| found.repeats[0].contains(k)), "{wrong:?} {:?}", found.repeats[0]);
        assert!(found.repeats[0].iter().all(|k| wanted.contains(k)), "{:?}", found.repeats[0]);
        // A sensor whose zero lies far from the motion drops the same samples.
        let lifted: Vec<f64> = held.iter().map(|y| y + 100.0).collect();
        let lifted = of_outputs(&[record(vec![lifted])], &errors(&held), &[0.005], &settings).remove(0);
        assert_eq!(lifted.repeats, found.repeats);
        for share in [0.5, 0.9] {
            let rail = share * smooth[peak].abs();
            let clipped: Vec<f64> = smooth.iter().map(|y| on_grid(&y.clamp(-rail, rail))).collect();
            let found = of_outputs(&[record(vec![clipped.clone()])], &errors(&clipped), &[0.005], &settings).remove(0);
            assert_eq!(found.dropout_rate, None, "{share}");
        }
    }

    /// The same steps are coarse if the sensor is as quiet as declared, and not if its noise hides them.
    #[test]
    fn a_converter_is_not_coarse_where_noise_hides_its_step() {
        let settings = SignalSettings::default();
        let (signal, noise) =
            (testing::random_input(3, 4000, 1).remove(0), testing::random_input(4, 4000, 1).remove(0));
        for (std, coarse) in [(0.002, true), (0.1, false)] {
            let rounded = |clean: &dyn Fn(usize) -> f64| -> Vec<f64> {
                (0..4000).map(|k| 0.02 * ((clean(k) + std * noise[k]) / 0.02).round()).collect()
            };
            let driven = record(vec![rounded(&|k| signal[k])]);
            let quiet = Record { excitation: Excitation::Zero, ..record(vec![rounded(&|_| 0.0)]) };
            let errors = vec![vec![vec![0.0; 4000]]; 2];
            let found = of_outputs(&[driven, quiet], &errors, &[0.002], &settings);
            assert_eq!(found[0].coarse, coarse, "{std}");
        }
    }

    /// A quiet record gives the noise of a moving signal, whatever its position between two codes. The variance of the
    /// quiet record itself is too small.
    #[test]
    fn codes_at_rest_show_the_noise_before_the_converter() {
        const STEP: f64 = 0.02;
        let (signal, noise) =
            (testing::random_input(3, 8000, 1).remove(0), testing::random_input(4, 8000, 1).remove(0));
        for std in [0.2 * STEP, 0.3 * STEP, 0.4 * STEP] {
            for at in [0.0, 0.2 * STEP, 0.4 * STEP] {
                let rounded = |clean: &dyn Fn(usize) -> f64| -> Vec<f64> {
                    (0..8000).map(|k| STEP * ((clean(k) + std * noise[k]) / STEP).round()).collect()
                };
                let driven = rounded(&|k| signal[k]);
                let error = rms(driven.iter().zip(&signal).map(|(y, signal)| y - signal)).powi(2);
                let quiet = Record { excitation: Excitation::Zero, ..record(vec![rounded(&|_| at)]) };
                let found = hidden(&[record(vec![driven]), quiet.clone()], 0, STEP).unwrap() + STEP * STEP / 12.0;
                // Where no value crosses one of the edges, the noise may be smaller than the estimate.
                let most = if at > 0.3 * STEP && std < 0.25 * STEP { 0.15 } else { 0.08 };
                assert!((found / error - 1.0).abs() < most, "{std} {at}: {found} for {error}");
                // Near the middle of a code, the record's own variance is too small.
                let mean = mean(&quiet.y[0]);
                let shown = rms(quiet.y[0].iter().map(|y| y - mean)).powi(2);
                assert!(at > 0.3 * STEP || shown < 0.95 * error, "{std} {at}: {shown} for {error}");
            }
        }
        // Noise of many steps is visible as such, and a constant record contains no information about the noise.
        for std in [2.0 * STEP, 0.0] {
            let y = noise.iter().map(|n| STEP * (std * n / STEP).round()).collect();
            assert_eq!(hidden(&[Record { excitation: Excitation::Zero, ..record(vec![y]) }], 0, STEP), None, "{std}");
        }
    }

    /// The three channels contain one signal: fine, rounded coarsely, and truncated coarsely, with steps from a fifth
    /// of the signal's size to its full size.
    #[test]
    fn a_converter_that_cuts_is_told_from_one_that_rounds() {
        for share in [0.2, 0.5, 1.0] {
            let y = testing::random_input(3, 4000, 1).remove(0);
            let rounded = y.iter().map(|y| share * (y / share).round()).collect();
            let cut: Vec<f64> = y.iter().map(|y| share * (y / share).trunc()).collect();
            let mut records = vec![record(vec![y.clone(), rounded, cut])];
            let errors = vec![vec![vec![0.0; 4000]; 3]];
            let found = of_outputs(&records, &errors, &[1e-3; 3], &SignalSettings::default());
            assert_eq!(
                found.iter().map(|c| (c.grid, c.coarse, c.cut)).collect::<Vec<_>>(),
                [(false, false, false), (true, true, false), (true, true, true)]
            );
            let mean = |records: &[Record]| {
                records[0].y[2].iter().zip(&y).map(|(a, y)| (y - a) * y.signum()).sum::<f64>() / 4000.0
            };
            let before = mean(&records);
            // The errors of an exact simulation.
            let left = records[0].y.iter().map(|given| given.iter().zip(&y).map(|(a, y)| a - y).collect()).collect();
            mend(&mut records, &[left], &found);
            assert!(mean(&records).abs() < 0.2 * before, "{} of {before}", mean(&records));
        }
    }

    /// Values at rest before the motion begins lie in the code zero as well.
    #[test]
    fn a_start_at_rest_is_no_truncation() {
        for share in [0.05, 0.2] {
            let mut y = vec![0.0; 200];
            y.extend(testing::random_input(3, 4000, 1).remove(0));
            let rounded = y.iter().map(|y| share * (y / share).round()).collect();
            let cut = y.iter().map(|y| share * (y / share).trunc()).collect();
            let errors = vec![vec![vec![0.0; y.len()]; 2]];
            let found = of_outputs(&[record(vec![rounded, cut])], &errors, &[1e-3; 2], &SignalSettings::default());
            assert_eq!(found.iter().map(|c| (c.coarse, c.cut)).collect::<Vec<_>>(), [(true, false), (true, true)]);
        }
    }

    /// A weak record whose values rarely leave the code zero does not make rounding look like truncation.
    #[test]
    fn a_weak_record_does_not_make_rounding_truncation() {
        const STEP: f64 = 2.0;
        let y = testing::random_input(3, 4000, 1).remove(0);
        let rounded = |size: f64| record(vec![y.iter().map(|y| STEP * (size * y / STEP).round()).collect()]);
        let fine = |size: f64| y.iter().map(|y| size * y).collect::<Vec<f64>>();
        let records = [1.0, 0.4].map(|size| Record { y: vec![fine(size), rounded(size).y.remove(0)], ..rounded(size) });
        let errors = vec![vec![vec![0.0; 4000]; 2]; 2];
        let found = of_outputs(&records, &errors, &[1e-3; 2], &SignalSettings::default());
        assert!(found[1].coarse && !found[1].cut);
    }

    /// With a simulation that is off by a hundredth of a step, most of the rounding error is removed for a step of
    /// twice the signal's size, wherever the codes lie. With a simulation that is off by as much as a step, the values
    /// stay as they are.
    #[test]
    fn the_error_of_rounding_is_predicted_by_a_good_simulation() {
        const STEP: f64 = 2.0;
        let y = testing::random_input(3, 4000, 1).remove(0);
        let noise = testing::random_input(4, 4000, 1).remove(0);
        for off in [0.0, 0.7] {
            let code = |y: &f64| STEP * ((y - off) / STEP).round() + off;
            let rounded: Vec<f64> = y.iter().map(code).collect();
            let of = |y: Vec<f64>| vec![record(vec![y])];
            let seen = of_outputs(&of(rounded.clone()), &[vec![vec![0.0; 4000]]], &[1e-3], &SignalSettings::default());
            assert!(seen[0].rounds());
            let left = |by: f64| {
                let mut records = of(rounded.clone());
                let simulated = y.iter().zip(&noise).map(|(y, noise)| y + by * noise).collect();
                unround(&mut records, &[vec![simulated]], &seen);
                rms(records[0].y[0].iter().zip(&y).map(|(mended, y)| mended - y))
            };
            let before = rms(rounded.iter().zip(&y).map(|(rounded, y)| rounded - y));
            assert!(left(0.02) < 0.3 * before, "{} of {before}", left(0.02));
            assert!((left(2.0) / before - 1.0).abs() < 0.01, "{} of {before}", left(2.0));
        }
    }

    /// The expected error of rounding agrees with the sum over the codes.
    #[test]
    fn the_expected_error_of_rounding_is_that_of_its_codes() {
        let normal = Normal::standard();
        for std in [0.05, 0.2, 0.5] {
            for mean in [-1.3, -0.2, 0.0, 0.45, 0.5, 2.7] {
                let below = |edge: f64| normal.cdf((edge - mean) / std);
                let code = |code: i32| f64::from(code) * (below(f64::from(code) + 0.5) - below(f64::from(code) - 0.5));
                let expected = (-10..=10).map(code).sum::<f64>() - mean;
                let found = expected_rounding(mean, std);
                assert!((found - expected).abs() < 1e-9, "{mean} {std}: {found} for {expected}");
            }
        }
    }
}
