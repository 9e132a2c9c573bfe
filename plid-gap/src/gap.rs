//! Gaps: RMS(y - y_sim) / RMS(y) over all outputs, each scaled to unit RMS.

use rand::RngExt;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::record::rms;

/// Blocks of a record that are drawn anew in a bootstrap.
const BLOCKS: usize = 24;

/// Draws of a bootstrap.
const DRAWS: usize = 400;

/// Squared errors and squared outputs by block: of each output, of each block.
#[derive(Debug, Clone)]
pub struct Blocks {
    error: Vec<Vec<f64>>,
    output: Vec<Vec<f64>>,
}

impl Blocks {
    /// Of measured and simulated outputs (p channels), from sample `from` on.
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

    /// The relative gap.
    pub fn gap(&self) -> f64 {
        let all: Vec<usize> = (0..self.error[0].len()).collect();
        self.of(&all)
    }

    fn of(&self, blocks: &[usize]) -> f64 {
        let share = |o: usize| {
            let sum = |values: &[f64]| blocks.iter().map(|&b| values[b]).sum::<f64>();
            sum(&self.error[o]) / sum(&self.output[o]).max(f64::MIN_POSITIVE)
        };
        let p = self.error.len();
        ((0..p).map(share).sum::<f64>() / p as f64).sqrt()
    }

    /// Share of each output in the squared gap beyond the noise.
    pub fn channels(&self, noise: &[f64], samples: usize) -> Vec<f64> {
        let beyond: Vec<f64> = (0..self.error.len())
            .map(|o| {
                let (error, output) = (self.error[o].iter().sum::<f64>(), self.output[o].iter().sum::<f64>());
                (error - noise[o] * noise[o] * samples as f64).max(0.0) / output.max(f64::MIN_POSITIVE)
            })
            .collect();
        let all: f64 = beyond.iter().sum();
        beyond.iter().map(|x| if all > 0.0 { x / all } else { 0.0 }).collect()
    }
}

/// 1 - (gap after beyond the floor) / (gap before beyond the floor).
pub fn shrink(before: f64, after: f64, floor: f64) -> f64 {
    let beyond = |gap: f64| (gap * gap - floor * floor).max(0.0).sqrt();
    let given = beyond(before);
    if given > 0.0 { 1.0 - beyond(after) / given } else { 0.0 }
}

/// The shrink's 95 % interval by drawing blocks of the record anew.
pub fn shrink_interval(before: &Blocks, after: &Blocks, floor: f64) -> [f64; 2] {
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let count = before.error[0].len();
    let mut drawn: Vec<f64> = (0..DRAWS)
        .map(|_| {
            let blocks: Vec<usize> = (0..count).map(|_| rng.random_range(0..count)).collect();
            shrink(before.of(&blocks), after.of(&blocks), floor)
        })
        .collect();
    drawn.sort_by(f64::total_cmp);
    [drawn[DRAWS / 40], drawn[DRAWS - 1 - DRAWS / 40]]
}

/// The gap that noise alone makes.
pub fn floor(noise: &[f64], y: &[Vec<f64>]) -> f64 {
    let share = |o: usize| (noise[o] / rms(y[o].iter().filter(|y| y.is_finite())).max(f64::MIN_POSITIVE)).powi(2);
    ((0..y.len()).map(share).sum::<f64>() / y.len() as f64).sqrt()
}
