//! The noise that repeats of an input show: differences between records with the same input, and between segments of
//! a record in which the input repeats exactly.
//!
//! Whatever a plant makes of an input, it makes of the repeat, so the difference of the outputs is noise. It also
//! contains the transient of the initial states if these differ; the beginning is then left out, up to a settling time.
//! If the plant has changed between the repeats, the difference also contains what the input makes of the change. The
//! local polynomial method then takes this part out.

use std::collections::HashMap;

use super::Stretch;
use super::local_polynomial::unexplained;
use crate::case::record::{Channels, Record};
use crate::plant::Plant;
use plid_fourier::C;
use plid_model::eigenvalues;
use plid_model::signal::mean;

/// Largest difference between two inputs that are the same, over their largest value: the rounding of a file with five
/// digits.
const ROUNDING: f64 = 1e-5;

/// Time constants of the slowest decay after which a transient has settled: it is then a thousandth of its size.
const SETTLED: f64 = 7.0;

/// Distance from one within which a pole is an integrator's. Its transient is a constant or a ramp, which every stretch
/// is freed from.
const INTEGRATOR: f64 = 1e-6;

/// Standard deviations by which the power of a difference must exceed the part that the inputs do not explain for the
/// plant to have changed.
const CHANGED: f64 = 5.0;

/// An odd number whose powers spread the bits of a sum over windows.
const BASE: u64 = 0x9e37_79b9_7f4a_7c15;

/// Returns the number of samples after which different initial states no longer matter; `None` if they matter for
/// ever, or if that depends on a controller.
pub(crate) fn settling(plant: &Plant) -> Option<usize> {
    if plant.controller.is_some() {
        return None;
    }
    let modes = plant.modes.iter().map(|mode| -mode.pole.re / plant.rate);
    let poles = eigenvalues(&plant.rest.a).ok()?;
    let others = poles.iter().filter(|z| (**z - 1.0).norm() > INTEGRATOR).map(|z| -z.norm().ln());
    let slowest = modes.chain(others).fold(f64::INFINITY, f64::min);
    (slowest > 0.0).then(|| (SETTLED / slowest).ceil() as usize)
}

/// Returns the differences between repeats, each of at least `shortest` samples. No sample is used twice.
pub(crate) fn differences(records: &[&Record], settling: Option<usize>, shortest: usize) -> Vec<Stretch> {
    let mut left: Vec<&Record> = records.iter().copied().filter(|record| record.is_driven()).collect();
    let mut found = Vec::new();
    while let Some(record) = left.pop() {
        let between = |other: &Record| of_records(other, record, settling, shortest);
        match left.iter().enumerate().find_map(|(at, other)| Some((at, between(other)?))) {
            Some((at, stretch)) => {
                left.remove(at);
                found.push(stretch);
            }
            None => found.extend(settling.into_iter().flat_map(|settling| within(record, settling, shortest))),
        }
    }
    found
}

/// Returns the difference between two records; `None` if their inputs differ or if they are too short.
fn of_records(a: &Record, b: &Record, settling: Option<usize>, shortest: usize) -> Option<Stretch> {
    let from = if a.from_rest && b.from_rest { 0 } else { settling? };
    let samples = a.samples().min(b.samples());
    let long_enough = samples >= from + shortest;
    (long_enough && have_same_input(a, b)).then(|| difference([a, b], [from; 2], samples - from))
}

/// Returns whether two records have the same inputs, to within rounding, for as long as both last.
fn have_same_input(a: &Record, b: &Record) -> bool {
    let same = |(a, b): (&Vec<f64>, &Vec<f64>)| {
        let largest = a.iter().chain(b).fold(0.0, |largest: f64, u| largest.max(u.abs()));
        a.iter().zip(b).all(|(a, b)| (a - b).abs() <= ROUNDING * largest)
    };
    a.u.iter().zip(&b.u).all(same)
}

/// Returns the difference of the responses to the same input, scaled so that it has the variance of the noise of one.
fn difference([a, b]: [&Record; 2], from: [usize; 2], samples: usize) -> Stretch {
    let part = |channels: &Channels, from: usize| -> Channels {
        channels.iter().map(|x| x[from..from + samples].to_vec()).collect()
    };
    let mut y = part(&b.y, from[1]);
    for (y, a) in y.iter_mut().zip(&a.y) {
        y.iter_mut().zip(&a[from[0]..]).for_each(|(y, a)| *y = (*y - a) * std::f64::consts::FRAC_1_SQRT_2);
    }
    let whole = Stretch::new(&y);
    let record = Record { u: part(&a.u, from[0]), y: y.clone(), simulated: None, ..a.clone() };
    unexplained(&record, &y).filter(|rest| is_louder(&whole, rest)).unwrap_or(whole)
}

/// Returns whether an output has more power in one stretch than in another, by more than chance.
fn is_louder(whole: &Stretch, rest: &Stretch) -> bool {
    let power = |bins: &Vec<C>| mean(bins.iter().map(C::norm_sqr));
    let scatter = (2.0 / whole.freedom + 2.0 / rest.freedom).sqrt();
    let mut ratios = whole.bins.iter().zip(&rest.bins).map(|(whole, rest)| power(whole) / power(rest));
    ratios.any(|ratio| ratio - 1.0 > CHANGED * scatter)
}

/// Returns the differences between segments of a record in which all inputs repeat to the last digit.
fn within(record: &Record, settling: usize, shortest: usize) -> Vec<Stretch> {
    let samples = record.samples();
    let is_same = |a: usize, b: usize| record.u.iter().all(|u| u[a] == u[b]);
    let windows = windows(&record.u, shortest);
    let (mut seen, mut found, mut k) = (HashMap::new(), Vec::new(), 0);
    while k < windows.len() {
        // Where nothing changes, every window is like the next one.
        let Some(window) = windows[k] else {
            k += 1;
            continue;
        };
        let first = *seen.entry(window).or_insert(k);
        // Segments that overlap would share samples.
        let longest = (k - first).min(samples - k);
        let same = (0..longest).take_while(|n| is_same(first + n, k + n)).count();
        if same >= settling + shortest {
            let from = [first + settling, k + settling];
            found.push(difference([record; 2], from, same - settling));
            seen.clear();
        }
        k += same.max(1);
    }
    found
}

/// Returns a number for each window of `length` samples by which equal windows are found; `None` where the inputs are
/// constant.
fn windows(u: &[Vec<f64>], length: usize) -> Vec<Option<u64>> {
    let samples = u.first().map_or(0, Vec::len);
    // Adding zero makes the two zeros equal.
    let mix = |sum: u64, u: f64| (sum ^ (u + 0.0).to_bits()).wrapping_mul(BASE).rotate_left(29);
    let values: Vec<u64> = (0..samples).map(|k| u.iter().fold(0, |sum, u| mix(sum, u[k]))).collect();
    let oldest = (1..length).fold(1, |power: u64, _| power.wrapping_mul(BASE));
    let (mut sum, mut constant, mut found) = (0_u64, 0, Vec::new());
    for (k, value) in values.iter().enumerate() {
        if k >= length {
            sum = sum.wrapping_sub(values[k - length].wrapping_mul(oldest));
        }
        sum = sum.wrapping_mul(BASE).wrapping_add(*value);
        constant = if k > 0 && values[k - 1] == *value { constant + 1 } else { 1 };
        if k + 1 >= length {
            found.push((constant < length).then_some(sum));
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{add_noise, random_input, record};

    const SHORTEST: usize = 512;
    const SETTLING: usize = 70;
    const STD: f64 = 0.01;

    /// Returns the record of a plant that is not linear and forgets a tenth of its state in a sample.
    fn measured(u: Vec<f64>, gain: f64, seed: u64) -> Record {
        let mut x = 0.0;
        let clean = u.iter().map(|u| {
            x = 0.9 * x + 0.1 * u;
            gain * (x + 0.1 * x * x)
        });
        let mut y = vec![clean.collect::<Vec<f64>>()];
        add_noise(&mut y, seed, &[STD]);
        record(vec![u], y)
    }

    fn drawn(seed: u64, samples: usize) -> Vec<f64> {
        random_input(seed, samples, 1).remove(0)
    }

    fn found(records: &[Record], settling: Option<usize>) -> Vec<Stretch> {
        differences(&records.iter().collect::<Vec<_>>(), settling, SHORTEST)
    }

    /// Checks that stretches have the power of the noise.
    fn are_noise(stretches: &[Stretch]) {
        for stretch in stretches {
            let ratio = mean(stretch.bins[0].iter().map(C::norm_sqr)) / (STD * STD);
            assert!((ratio - 1.0).abs() < 4.0 * (2.0 / stretch.freedom).sqrt(), "{ratio}");
        }
    }

    /// Records with the same input, to within the rounding of a file, are differenced in pairs. A record with another
    /// input is not, even if only one sample differs.
    #[test]
    fn records_with_the_same_input_show_the_noise() {
        let u = drawn(1, 2000);
        let rounded = u.iter().map(|u| (1e6 * u).round() / 1e6).collect();
        let mut other = u.clone();
        other[1500] += 0.01;
        let all = [u.clone(), other, rounded, drawn(2, 2000)];
        let mut records: Vec<Record> = all.into_iter().zip(11..).map(|(u, seed)| measured(u, 1.0, seed)).collect();
        let pair = found(&records, Some(SETTLING));
        assert_eq!(pair.iter().map(|stretch| stretch.length).collect::<Vec<_>>(), [2000]);
        are_noise(&pair);
        records.remove(2);
        assert!(found(&records, Some(SETTLING)).is_empty());
    }

    /// If a record does not begin at rest, the transient is left out. If it never settles, nothing is found.
    #[test]
    fn a_transient_is_no_noise() {
        let u = drawn(3, 2000);
        let before = [vec![8.0; 300], u.clone()].concat();
        let late = Record { from_rest: false, ..measured(before, 1.0, 21).part(300..2300, 1.0) };
        let records = [measured(u, 1.0, 22), late];
        let settled = found(&records, Some(SETTLING));
        assert_eq!(settled.len(), 1);
        are_noise(&settled);
        assert!(found(&records, None).is_empty());
        assert!(found(&records, Some(1600)).is_empty());
    }

    /// The noise is that of the sensor although the gain has changed by a tenth between two records.
    #[test]
    fn a_change_between_repeats_is_no_noise() {
        let u = drawn(4, 4000);
        are_noise(&found(&[measured(u.clone(), 1.0, 31), measured(u, 1.1, 32)], Some(SETTLING)));
    }

    /// Segments of a record are differenced where its input repeats exactly, and every segment once.
    #[test]
    fn a_repeated_segment_shows_the_noise() {
        let [a, b] = [5, 6].map(|seed| drawn(seed, 900));
        let stretches = found(&[measured([&a[..], &b, &a, &a[..300], &a].concat(), 1.0, 41)], Some(SETTLING));
        assert_eq!(stretches.len(), 1);
        assert!((800..=900 - SETTLING).contains(&stretches[0].length), "{}", stretches[0].length);
        are_noise(&stretches);
        let mut unequal = [&a[..], &b, &a].concat();
        assert_eq!(found(&[measured(unequal.clone(), 1.0, 41)], Some(SETTLING)).len(), 1);
        unequal[2250] += 1e-9;
        assert!(found(&[measured(unequal, 1.0, 41)], Some(SETTLING)).is_empty());
        // Two periods of a short one are a segment that is long enough.
        let periodic = found(&[measured(a[..400].repeat(5), 1.0, 42)], Some(SETTLING));
        assert_eq!(periodic.len(), 1);
        are_noise(&periodic);
        // A constant input is like its own repeat at every sample.
        let constant = measured(vec![1.0; 3000], 1.0, 43);
        assert!(found(&[constant], Some(SETTLING)).is_empty());
    }

    #[test]
    fn the_slowest_decay_tells_when_a_plant_has_settled() {
        use nalgebra::dmatrix;
        use plid_model::Model;
        let of = |slow: f64| {
            let a = dmatrix![slow, 0.0; 0.0, 0.5];
            let model = Model::new(1.0, a, dmatrix![1.0; 1.0], dmatrix![1.0, 1.0], dmatrix![0.0]).unwrap();
            settling(&Plant::new(&model).unwrap())
        };
        assert_eq!(of(0.9), Some((SETTLED / -0.9_f64.ln()).ceil() as usize));
        // An integrator settles on a constant.
        assert_eq!(of(1.0), Some((SETTLED / -0.5_f64.ln()).ceil() as usize));
        assert_eq!(of(1.01), None);
    }
}
