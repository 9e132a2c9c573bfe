//! Gaps: RMS(y - y_sim) / RMS(y) over all outputs, each output scaled to unit RMS.

use rand::RngExt;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use plid_model::signal::mean;

use crate::case::record::{Channels, Excitation, Record, rms};

/// Number of blocks of a record in a bootstrap.
const BLOCKS: usize = 24;

/// Number of draws of a bootstrap.
const DRAWS: usize = 400;

/// Standard deviation of the logarithm of an output's power between records of one level.
const OUTPUT_SCATTER: f64 = 0.2;

/// Prior standard deviation of the exponent of level^2 in the power of an output; the prior mean is 1.
const EXPONENT_STD: f64 = 0.5;

/// Squared errors and squared outputs, for each output and each block.
#[derive(Debug, Clone)]
pub struct Blocks {
    error: Vec<Vec<f64>>,
    output: Vec<Vec<f64>>,
}

impl Blocks {
    /// Computes the blocks of measured and simulated outputs (p channels), from sample `from` on.
    pub fn new(y: &[Vec<f64>], simulated: &[Vec<f64>], from: usize) -> Self {
        let samples = y[0].len() - from;
        let each = samples.div_ceil(BLOCKS).max(1);
        let sums = |values: &dyn Fn(usize, usize) -> f64| -> Vec<Vec<f64>> {
            (0..y.len())
                .map(|o| {
                    let starts = (from..y[o].len()).step_by(each);
                    starts.map(|at| (at..(at + each).min(y[o].len())).map(|k| values(o, k)).sum()).collect()
                })
                .collect()
        };
        let finite = |o: usize, k: usize, x: f64| if y[o][k].is_finite() { x } else { 0.0 };
        Self {
            error: sums(&|o, k| finite(o, k, (y[o][k] - simulated[o][k]).powi(2))),
            output: sums(&|o, k| finite(o, k, y[o][k].powi(2))),
        }
    }

    /// Joins the blocks of several records.
    pub fn joined(all: Vec<Self>) -> Option<Self> {
        all.into_iter().reduce(|mut joined, next| {
            let join = |to: &mut Vec<Vec<f64>>, from: Vec<Vec<f64>>| {
                to.iter_mut().zip(from).for_each(|(to, from)| to.extend(from));
            };
            join(&mut joined.error, next.error);
            join(&mut joined.output, next.output);
            joined
        })
    }

    /// Returns the relative gap.
    pub fn gap(&self) -> f64 {
        let all: Vec<usize> = (0..self.error[0].len()).collect();
        self.of(&all)
    }

    /// Returns, for each block, by how much the squared error is below that of another simulation of the same records,
    /// with each output scaled to unit RMS over all blocks.
    pub fn gains_over(&self, other: &Self) -> Vec<f64> {
        let power: Vec<f64> = self.output.iter().map(|o| o.iter().sum::<f64>().max(f64::MIN_POSITIVE)).collect();
        let gain = |b: usize| (0..power.len()).map(|o| (other.error[o][b] - self.error[o][b]) / power[o]).sum();
        (0..self.error[0].len()).map(gain).collect()
    }

    fn of(&self, blocks: &[usize]) -> f64 {
        let share = |o: usize| {
            let sum = |values: &[f64]| blocks.iter().map(|&b| values[b]).sum::<f64>();
            sum(&self.error[o]) / sum(&self.output[o]).max(f64::MIN_POSITIVE)
        };
        let p = self.error.len();
        ((0..p).map(share).sum::<f64>() / p as f64).sqrt()
    }
}

/// Returns channels without their means over the samples in which outputs were measured.
pub fn motion(channels: &[Vec<f64>], measured: &[Vec<f64>]) -> Channels {
    let of_channel = |(x, y): (&Vec<f64>, &Vec<f64>)| -> Vec<f64> {
        let used: Vec<f64> = x.iter().zip(y).filter(|(_, y)| y.is_finite()).map(|(x, _)| *x).collect();
        let constant = mean(&used);
        x.iter().map(|x| x - constant).collect()
    };
    channels.iter().zip(measured).map(of_channel).collect()
}

/// Returns 1 - (gap after) / (gap before), both beyond the floor.
pub fn shrink(before: f64, after: f64, floor: f64) -> f64 {
    let beyond = |gap: f64| (gap * gap - floor * floor).max(0.0).sqrt();
    let given = beyond(before);
    if given > 0.0 { 1.0 - beyond(after) / given } else { 0.0 }
}

/// Returns the 95 % interval of a function of several gaps by a bootstrap over blocks of the record, with the same
/// blocks for all gaps.
pub fn drawn<const K: usize>(simulated: [&Blocks; K], figure: impl Fn([f64; K]) -> f64) -> [f64; 2] {
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let count = simulated.first().map_or(0, |first| first.error[0].len());
    middle((0..DRAWS).map(|_| {
        let blocks: Vec<usize> = (0..count).map(|_| rng.random_range(0..count)).collect();
        figure(simulated.map(|each| each.of(&blocks)))
    }))
}

/// Returns the share of bootstrap draws of blocks of the record for which a statement about several gaps is true.
pub fn how_often<const K: usize>(simulated: [&Blocks; K], is: impl Fn([f64; K]) -> bool) -> f64 {
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let count = simulated.first().map_or(0, |first| first.error[0].len());
    let drawn = (0..DRAWS).filter(|_| {
        let blocks: Vec<usize> = (0..count).map(|_| rng.random_range(0..count)).collect();
        is(simulated.map(|each| each.of(&blocks)))
    });
    drawn.count() as f64 / DRAWS as f64
}

/// Returns the middle 95 % of the draws; NaN without draws.
pub fn middle(drawn: impl Iterator<Item = f64>) -> [f64; 2] {
    let mut drawn: Vec<f64> = drawn.collect();
    drawn.sort_by(f64::total_cmp);
    let Some(last) = drawn.len().checked_sub(1) else { return [f64::NAN; 2] };
    [drawn[last / 40], drawn[last - last / 40]]
}

/// Returns the relative gap over all driven records together; zero if no record is driven.
pub fn of_driven(records: &[Record], simulated: &[Channels]) -> f64 {
    let driven = records.iter().zip(simulated).filter(|(record, _)| record.is_driven());
    let blocks = driven.map(|(record, simulated)| Blocks::new(&record.y, simulated, 0)).collect();
    Blocks::joined(blocks).map_or(0.0, |blocks| blocks.gap())
}

/// Returns the gap to expect on a record of this level, from the fitted records. Each output's error power is
/// modelled as a + b level^2 over all records, and the power of the simulated output as c level^q over the random
/// ones, if there are any. The exponent q is about 2 unless the records indicate otherwise, as those of a plant that
/// saturates do. The simulated output is used because the measured one contains relatively more noise at a low level.
/// The output of a lightly damped structure scatters by a tenth from record to record.
pub fn expected(records: &[Record], simulated: &[Channels], level: f64) -> f64 {
    let p = records[0].y.len();
    let periodic = |record: &Record| matches!(record.excitation, Excitation::Periodic(_));
    let random = records.iter().any(|record| record.is_driven() && !periodic(record));
    let power = |x: &mut dyn Iterator<Item = f64>| x.map(|x| x * x).sum::<f64>();
    let share = |o: usize| -> f64 {
        // Sums over records of the weight, weight x level^2, weight x level^4, error power, and error power x level^2.
        let mut sums = [0.0; 5];
        let mut outputs = Vec::new();
        for (record, simulated) in records.iter().zip(simulated) {
            let measured = || record.y[o].iter().zip(&simulated[o]).filter(|(y, _)| y.is_finite());
            let samples = measured().count() as f64;
            if samples == 0.0 {
                continue;
            }
            let error = power(&mut measured().map(|(y, s)| y - s));
            let square = record.level().powi(2);
            for (sum, term) in
                sums.iter_mut().zip([samples, samples * square, samples * square * square, error, error * square])
            {
                *sum += term;
            }
            let output = power(&mut measured().map(|(_, s)| *s));
            if square > 0.0 && output > 0.0 && !(random && periodic(record)) {
                outputs.push((samples, square.ln(), (output / samples).ln()));
            }
        }
        let [w, x, xx, e, ex] = sums;
        let determinant = w * xx - x * x;
        let slope = if determinant > 1e-9 * w * xx { (w * ex - x * e) / determinant } else { 0.0 };
        let slope = slope.min(e / x.max(f64::MIN_POSITIVE)).max(0.0);
        let error = (e - slope * x) / w + slope * level * level;
        let output = output_power(&outputs, level) + error;
        error / output.max(f64::MIN_POSITIVE)
    };
    ((0..p).map(share).sum::<f64>() / p as f64).sqrt()
}

/// The reach of a curve without a law: nothing is known of it at higher levels than the fitted ones.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reach {
    /// The highest level that counts as fitted.
    pub level: f64,
    /// The correction by the effects in the loudest fitted records, relative to the outputs.
    pub correction: f64,
}

impl Reach {
    /// Returns the reach of effects, from the free runs of the fitted records with and without them. Levels whose ratio
    /// is below `same_level` count as one level.
    pub fn of(records: &[Record], with: &[Channels], without: &[Channels], same_level: f64) -> Self {
        let most = records.iter().map(Record::level).fold(0.0, f64::max);
        let loudest = (0..records.len()).filter(|&k| same_level * records[k].level() > most);
        let blocks = Blocks::joined(loudest.map(|k| Blocks::new(&with[k], &without[k], 0)).collect());
        Self { level: same_level * most, correction: blocks.map_or(0.0, |blocks| blocks.gap()) }
    }
}

/// Returns the gap to expect as [`expected`] does, except beyond the reach of a curve without a law. There, the error
/// is that at the end of the reach, and the whole correction is uncertain.
pub fn expected_within(records: &[Record], simulated: &[Channels], reach: Option<Reach>, level: f64) -> f64 {
    match reach.filter(|reach| level > reach.level) {
        Some(reach) => expected(records, simulated, reach.level).hypot(reach.correction),
        None => expected(records, simulated, level),
    }
}

/// Returns the power of an output at a level. Each record contributes its weight, the logarithm of level^2, and the
/// logarithm of the output's power. The prior mean of the exponent is that of a linear plant.
fn output_power(outputs: &[(f64, f64, f64)], level: f64) -> f64 {
    let weight: f64 = outputs.iter().map(|(w, ..)| w).sum();
    if weight == 0.0 {
        return 0.0;
    }
    let mean = |of: &dyn Fn(f64, f64) -> f64| outputs.iter().map(|&(w, x, y)| w * of(x, y)).sum::<f64>() / weight;
    let (x0, y0) = (mean(&|x, _| x), mean(&|_, y| y));
    let (xx, xy) = (mean(&|x, _| (x - x0).powi(2)), mean(&|x, y| (x - x0) * (y - y0)));
    // Bayes: the exponent of level^2 has a normal prior, and the logarithms scatter.
    let prior = (OUTPUT_SCATTER / EXPONENT_STD).powi(2) / outputs.len() as f64;
    let exponent = (xy + prior) / (xx + prior);
    (y0 + exponent * (2.0 * level.ln() - x0)).exp()
}

/// Returns the gap of noise alone.
pub fn floor(noise: &[f64], y: &[Vec<f64>]) -> f64 {
    floor_over(noise, &[y])
}

/// Returns the gap of noise alone over several records, each of p channels.
pub fn floor_over(noise: &[f64], records: &[&[Vec<f64>]]) -> f64 {
    let size = |o: usize| rms(records.iter().flat_map(|y| y[o].iter().filter(|y| y.is_finite())));
    let share = |o: usize| (noise[o] / size(o).max(f64::MIN_POSITIVE)).powi(2);
    ((0..noise.len()).map(share).sum::<f64>() / noise.len() as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The first simulation is right in the first half and misses the second output, whose power is 4 in each sample,
    /// by one in the second half; the other simulation misses the first output by one everywhere.
    #[test]
    fn blocks_are_compared_one_by_one() {
        let y = [vec![1.0; 48], vec![2.0; 48]];
        let blocks = |simulated: [Vec<f64>; 2]| Blocks::new(&y, &simulated, 0);
        let half: Vec<f64> = (0..48).map(|k| if k < 24 { 2.0 } else { 3.0 }).collect();
        let gains = blocks([vec![1.0; 48], half]).gains_over(&blocks([vec![2.0; 48], vec![2.0; 48]]));
        let expected = |b: usize| 2.0 / 48.0 - if b < 12 { 0.0 } else { 2.0 / (4.0 * 48.0) };
        assert_eq!(gains.len(), 24);
        assert!(gains.iter().enumerate().all(|(b, gain)| (gain - expected(b)).abs() < 1e-12), "{gains:?}");
    }

    /// Noise of one size at two levels is a large part of the measured output at the lower level, but that has no
    /// bearing on the output of the louder record.
    #[test]
    fn noise_is_expected_beside_the_output_of_the_level_that_is_asked_for() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut white = |size: f64| -> Vec<f64> {
            (0..20_000).map(|_| size * (rng.random_range(0.0..1.0) - 0.5) * 12_f64.sqrt()).collect()
        };
        let (mut records, mut simulated) = (Vec::new(), Vec::new());
        for level in [1.0, 0.2] {
            let u = white(level);
            let y = u.iter().zip(white(0.3)).map(|(u, noise)| u + noise).collect();
            simulated.push(vec![u.clone()]);
            records.push(crate::testing::record(vec![u], vec![y]));
        }
        let level = records[0].level();
        let truth = 0.3 / (1.0_f64 + 0.09).sqrt();
        let stated = expected(&records, &simulated, level);
        assert!((stated / truth - 1.0).abs() < 0.02, "{stated} {truth}");
    }

    /// The output of a plant that saturates hardly grows with the level, so an error of constant size remains an
    /// equal share of it.
    #[test]
    fn the_output_of_a_plant_that_saturates_does_not_grow_with_the_level() {
        let error = crate::testing::random_input(1, 4000, 1).remove(0);
        let record = |level: f64| {
            let u: Vec<f64> = (0..4000).map(|k| level * (0.1 * f64::from(k)).sin()).collect();
            let y: Vec<f64> = u.iter().map(|u| (1e3 * u).tanh()).collect();
            let simulated: Vec<f64> = y.iter().zip(&error).map(|(y, e)| y + 0.2 * e).collect();
            (crate::testing::record(vec![u], vec![y]), vec![simulated])
        };
        let (records, simulated): (Vec<Record>, Vec<Channels>) = [0.1, 0.3, 1.0].map(record).into_iter().unzip();
        let stated = expected(&records, &simulated, records[2].level());
        assert!((stated - 0.2).abs() < 0.02, "{stated}");
    }

    /// Beyond the reach of a curve without a law, the whole correction is uncertain, and the error at the highest
    /// fitted level is not extrapolated. Within the reach, and for a law, nothing changes.
    #[test]
    fn a_curve_without_a_law_reaches_no_further_than_its_records() {
        let [u, correction, error] = [1, 2, 3].map(|seed| crate::testing::random_input(seed, 4000, 1).remove(0));
        let (mut records, mut with, mut without) = (Vec::new(), Vec::new(), Vec::new());
        // The curve corrects a fifth of the louder record's output.
        for (level, share) in [(0.5, 0.1), (1.0, 0.2)] {
            let scaled = |x: &[f64], by: f64| x.iter().map(|x| by * x).collect::<Vec<f64>>();
            let sum = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a + b).collect::<Vec<f64>>();
            let linear = scaled(&u, level);
            let simulated = sum(&linear, &scaled(&correction, share * level));
            let y = sum(&simulated, &scaled(&error, 0.05 * level * level));
            records.push(crate::testing::record(vec![linear.clone()], vec![y]));
            with.push(vec![simulated]);
            without.push(vec![linear]);
        }
        let most = records[1].level();
        let reach = Reach::of(&records, &with, &without, 1.15);
        assert!((reach.correction - 0.2).abs() < 0.01 && reach.level == 1.15 * most, "{reach:?}");
        let at = |reach: Option<Reach>, times: f64| expected_within(&records, &with, reach, times * most);
        for times in [0.3, 1.0, 1.1] {
            assert_eq!(at(Some(reach), times).to_bits(), expected(&records, &with, times * most).to_bits());
        }
        assert_eq!(at(None, 5.0).to_bits(), expected(&records, &with, 5.0 * most).to_bits());
        assert_eq!(at(Some(reach), 1.2), at(Some(reach), 5.0));
        assert!((at(Some(reach), 5.0) - at(None, 1.15).hypot(0.2)).abs() < 0.01, "{}", at(Some(reach), 5.0));
    }

    /// A fifth of the motion is missing. Beside the constant, it is hardly visible. Missing samples do not count.
    #[test]
    fn a_constant_is_no_motion() {
        let wave = |size: f64| -> Vec<f64> { (0..4800).map(|k| 50.0 + size * (0.1 * f64::from(k)).sin()).collect() };
        let (mut y, simulated) = (vec![wave(1.0)], vec![wave(0.8)]);
        y[0][100..140].fill(f64::NAN);
        assert!(Blocks::new(&y, &simulated, 0).gap() < 0.003);
        let moved = Blocks::new(&motion(&y, &y), &motion(&simulated, &y), 0).gap();
        assert!((moved - 0.2).abs() < 0.002, "{moved}");
    }
}
