//! The location of the gap by output, band, time and level, each share with its interval.

use nalgebra::DMatrix;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::case::record::{Channels, Excitation, Record, rms};
use crate::fit::free_run::run;
use crate::judge::gap::middle;
use crate::judge::growth::{differ, exponent};
use crate::noise::NoiseModel;
use crate::prepare::Prepared;
use crate::settings::GapSettings;
use crate::simulate::Fineness;
use plid_fourier::C;

/// Number of frequency bands.
pub const BANDS: usize = 24;

/// Number of stretches of time over all records.
pub const STRETCHES: usize = 8;

/// Number of bootstrap blocks in each stretch of time. In records of a few thousand samples, a block is longer than
/// the decay of a resonance.
const BLOCKS: usize = 8;

/// Number of draws of the bootstrap.
const DRAWS: usize = 400;

/// A figure with its 95 % interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// The value from all records.
    pub value: f64,
    /// The interval from a bootstrap over blocks of the records.
    pub ci95: [f64; 2],
}

/// The gap at a level.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LevelGap {
    /// Name of the record.
    pub record: String,
    /// RMS of its inputs.
    pub level: f64,
    /// Relative gap beyond the noise.
    pub gap: Estimate,
}

/// The map of a gap. The shares are those of the squared gap beyond the noise, with each output scaled to unit RMS.
#[derive(Debug, Clone, PartialEq)]
pub struct Map {
    /// Edges of the bands in Hz ([`BANDS`] + 1).
    pub edges: Vec<f64>,
    /// Share of each output (p) in each band.
    pub share: DMatrix<f64>,
    /// Share of each stretch of time in each band.
    pub time: DMatrix<f64>,
    /// Share of each output (p).
    pub outputs: Vec<Estimate>,
    /// Share of each band.
    pub bands: Vec<Estimate>,
    /// Share of each stretch of time.
    pub stretches: Vec<Estimate>,
    /// The gap of each driven random record, or of each driven periodic one if only these differ in level or none is
    /// random.
    pub levels: Vec<LevelGap>,
    /// Slope of the logarithm of the gap over that of the level, over the records whose gap exceeds the noise.
    pub slope: Option<Estimate>,
}

/// Returns the errors of the simulation as given (p channels), one for each record. Its initial states are those of
/// `eta`, the linear parameters of a refit.
pub fn errors(ready: &Prepared, eta: &[f64]) -> Vec<Channels> {
    let problem = &ready.problem;
    if let Some(best_linear) = &ready.best_linear {
        return problem.records.iter().map(|record| record.error(&run(best_linear, &[], record))).collect();
    }
    let eta = problem.nuisance.as_given(eta);
    (0..problem.records.len())
        .map(|index| {
            let y = problem.outputs(&problem.plant, &eta, &[], index, Fineness::COARSE);
            problem.records[index].error(&y)
        })
        .collect()
}

/// Computes the map, with intervals from a block bootstrap: from each stretch of time of each record, as many blocks
/// are drawn with replacement as it contains. The settings define which levels count as one, and the least spread of
/// levels for which a slope is stated.
pub fn map(records: &[Record], errors: &[Channels], noise: &NoiseModel, rate: f64, settings: &GapSettings) -> Map {
    let edges: Vec<f64> = (0..=BANDS).map(|k| 0.5 * rate * k as f64 / BANDS as f64).collect();
    let blocks = blocks(records, errors, noise, &edges);
    let whole = Sums::of(&blocks, &vec![1.0; blocks.len()]);
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let drawn: Vec<Sums> = (0..DRAWS).map(|_| Sums::of(&blocks, &draw(&blocks, &mut rng))).collect();
    let estimate = |of: &dyn Fn(&Sums) -> f64| Estimate { value: of(&whole), ci95: middle(drawn.iter().map(of)) };
    let row = |of: fn(&Sums) -> &DMatrix<f64>, k: usize| estimate(&move |sums| of(sums).row(k).sum());
    let level = |index: usize| LevelGap {
        record: records[index].name.clone(),
        level: records[index].level(),
        gap: estimate(&move |sums| sums.gap(index)),
    };
    let indices = of_levels(records, settings.case.same_level);
    let levels: Vec<LevelGap> = indices.iter().map(|&index| level(index)).collect();
    // A gap that is not significantly above the noise has no place on a logarithmic scale.
    let clear = levels.iter().zip(&indices).filter(|(level, _)| level.gap.ci95[0] > 0.0);
    let clear: Vec<(usize, f64)> = clear.map(|(level, &index)| (index, level.level)).collect();
    let spread = settings.judge.level_spread;
    let slope = whole
        .slope(&clear, spread)
        .map(|value| Estimate { value, ci95: middle(drawn.iter().filter_map(|sums| sums.slope(&clear, spread))) })
        // If no draw has a slope, the uncertainty is unknown.
        .filter(|slope| slope.ci95.iter().all(|end| end.is_finite()));
    Map {
        outputs: (0..whole.share.nrows()).map(|o| row(|sums| &sums.share, o)).collect(),
        bands: (0..BANDS).map(|b| estimate(&move |sums| sums.share.column(b).sum())).collect(),
        stretches: (0..STRETCHES).map(|stretch| row(|sums| &sums.time, stretch)).collect(),
        levels,
        slope,
        edges,
        share: whole.share,
        time: whole.time,
    }
}

/// A block of a record.
struct Block {
    record: usize,
    stretch: usize,
    /// Squared error beyond the noise, of each output in each band.
    beyond: DMatrix<f64>,
    /// Squared outputs.
    output: f64,
}

/// Divides all records into blocks, with each output scaled to unit RMS.
fn blocks(records: &[Record], errors: &[Channels], noise: &NoiseModel, edges: &[f64]) -> Vec<Block> {
    let p = records[0].y.len();
    let finite = |y: &&f64| y.is_finite();
    let scale: Vec<f64> =
        (0..p).map(|o| 1.0 / rms(records.iter().flat_map(|r| r.y[o].iter().filter(finite))).max(1e-300)).collect();
    // Noise power of each output in each band, per sample.
    let quiet = DMatrix::from_fn(p, BANDS, |o, b| {
        let within =
            (0..4).map(|j| noise.density(edges[b] + (edges[b + 1] - edges[b]) * (f64::from(j) + 0.5) / 4.0)[(o, o)].re);
        within.sum::<f64>() / 4.0 / BANDS as f64
    });
    let samples: usize = records.iter().map(Record::samples).sum();
    let each = samples.div_ceil(STRETCHES).max(1);
    let mut blocks = Vec::new();
    let mut began = 0;
    for (index, (record, error)) in records.iter().zip(errors).enumerate() {
        let first = blocks.len();
        let mut ends = vec![0];
        let mut from = 0;
        while from < record.samples() {
            let stretch = ((began + from) / each).min(STRETCHES - 1);
            let to = if stretch + 1 == STRETCHES {
                record.samples()
            } else {
                record.samples().min((stretch + 1) * each - began)
            };
            let count = ((to - from) * BLOCKS).div_ceil(each).clamp(1, to - from);
            for block in 0..count {
                ends.push(from + (to - from) * (block + 1) / count);
                blocks.push(Block { record: index, stretch, beyond: DMatrix::zeros(p, BANDS), output: 0.0 });
            }
            from = to;
        }
        for o in 0..p {
            let square = scale[o] * scale[o];
            for (block, end) in blocks[first..].iter_mut().zip(ends.windows(2)) {
                block.output += square * record.y[o][end[0]..end[1]].iter().filter(finite).map(|y| y * y).sum::<f64>();
            }
            for (b, within) in bands(&error[o]).into_iter().enumerate() {
                for (block, end) in blocks[first..].iter_mut().zip(ends.windows(2)) {
                    let power: f64 = within[end[0]..end[1]].iter().map(|x| x * x).sum();
                    block.beyond[(o, b)] = square * (power - quiet[(o, b)] * (end[1] - end[0]) as f64);
                }
            }
        }
        began += record.samples();
    }
    blocks
}

/// Divides a signal into bands whose sum is the signal.
fn bands(x: &[f64]) -> Vec<Vec<f64>> {
    let spectrum = plid_fourier::forward(x);
    let last = (spectrum.len() - 1).max(1);
    let within = |band: usize| {
        let of = |(k, z): (usize, &C)| if (k * BANDS / last).min(BANDS - 1) == band { *z } else { C::ZERO };
        plid_fourier::backward(&spectrum.iter().enumerate().map(of).collect::<Vec<C>>(), x.len())
    };
    (0..BANDS).map(within).collect()
}

/// Draws the count of each block: from each stretch of each record, as many blocks as it contains, with replacement.
fn draw(blocks: &[Block], rng: &mut ChaCha8Rng) -> Vec<f64> {
    let mut counts = vec![0.0; blocks.len()];
    let mut from = 0;
    for alike in blocks.chunk_by(|a, b| (a.record, a.stretch) == (b.record, b.stretch)) {
        for _ in alike {
            counts[from + rng.random_range(0..alike.len())] += 1.0;
        }
        from += alike.len();
    }
    counts
}

/// The shares and sums over blocks, each counted as often as it was drawn.
struct Sums {
    share: DMatrix<f64>,
    time: DMatrix<f64>,
    /// For each record, squared gap beyond the noise and squared outputs.
    records: Vec<(f64, f64)>,
}

impl Sums {
    fn of(blocks: &[Block], counts: &[f64]) -> Self {
        let p = blocks.first().map_or(0, |block| block.beyond.nrows());
        let (mut share, mut time) = (DMatrix::zeros(p, BANDS), DMatrix::zeros(STRETCHES, BANDS));
        let mut records = vec![(0.0, 0.0); blocks.last().map_or(0, |block| block.record + 1)];
        for (block, &count) in blocks.iter().zip(counts).filter(|(_, count)| **count > 0.0) {
            let (beyond, output) = &mut records[block.record];
            *output += count * block.output;
            for b in 0..BANDS {
                let mut column = 0.0;
                for o in 0..p {
                    share[(o, b)] += count * block.beyond[(o, b)];
                    column += block.beyond[(o, b)];
                }
                time[(block.stretch, b)] += count * column;
                *beyond += count * column;
            }
        }
        // A negative value means that the gap is below the noise.
        for shares in [&mut share, &mut time] {
            shares.iter_mut().for_each(|x: &mut f64| *x = x.max(0.0));
            let all = shares.sum();
            if all > 0.0 {
                *shares /= all;
            }
        }
        Self { share, time, records }
    }

    /// Returns the relative gap of a record.
    fn gap(&self, record: usize) -> f64 {
        let (beyond, output) = self.records[record];
        if output > 0.0 { (beyond.max(0.0) / output).sqrt() } else { 0.0 }
    }

    /// Returns the slope over records, each with its level; `None` if the squared distances of the levels' logarithms
    /// from their mean sum to less than `spread`.
    fn slope(&self, levels: &[(usize, f64)], spread: f64) -> Option<f64> {
        exponent(levels.iter().map(|&(record, level)| (level, self.gap(record))), spread)
    }
}

/// Returns the indices of the records that show how the gap depends on the level. They are either all random or all
/// periodic, because the gap of a periodic response is not comparable with that of a random one.
fn of_levels(records: &[Record], same_level: f64) -> Vec<usize> {
    let driven = |periodic: bool| -> Vec<usize> {
        let kind = |r: &Record| matches!(r.excitation, Excitation::Periodic(_)) == periodic;
        (0..records.len()).filter(|&k| kind(&records[k]) && records[k].is_driven()).collect()
    };
    let differ = |of: &Vec<usize>| differ(of.iter().map(|&k| records[k].level()), same_level);
    let [random, periodic] = [false, true].map(driven);
    if differ(&random) || !differ(&periodic) && !random.is_empty() { random } else { periodic }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::refit::{STEPS, refit};
    use crate::prepare::{Known, prepare};
    use crate::testing;

    /// A right simulation has no gap where a record begins in motion: its initial states are fitted.
    #[test]
    fn a_start_in_motion_is_no_gap() {
        let sim = testing::truss(1);
        let mut case = testing::case(&sim, &sim);
        for record in &mut case.records {
            record.u.iter_mut().chain(&mut record.y).for_each(|channel| drop(channel.drain(..300)));
            record.from_rest = false;
        }
        let ready = prepare(case.model.as_ref().unwrap(), &case.records, &Known::default()).unwrap();
        let eta = refit(&ready.problem, STEPS).eta;
        let left = rms(errors(&ready, &eta)[1].iter().flatten());
        let size = rms(ready.problem.records[1].y.iter().flatten());
        assert!(left < 0.02 * size, "{left} {size}");
    }
}
