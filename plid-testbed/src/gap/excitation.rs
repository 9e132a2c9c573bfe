//! The records of a case: the commands and their times.

use std::f64::consts::PI;

use ndarray::{Array2, s};
use rand::RngExt;
use serde::{Deserialize, Serialize};

use super::rig::{PERIOD, Rig};
use super::spec::{Experiment, GapSpec};
use crate::INPUTS;
use crate::converter::Converter;
use crate::input::{low_passed, scaled_to};
use crate::record::convert;
use crate::streams::{Purpose, stream};

/// The excitation of a record.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Excitation {
    /// No excitation.
    Zero,
    /// Gaussian noise below a cut-off frequency, which is 200 Hz for structures.
    Random {
        /// RMS of each input, V.
        level_v: f64,
    },
    /// Periods of a multisine with odd lines and random phases, 1 V RMS.
    Periodic {
        /// Number of samples in a period.
        period: usize,
    },
}

/// A record before it is taken.
pub(crate) struct Planned {
    pub excitation: Excitation,
    /// Commands as the DAC gives them; zero where the case has no input.
    pub commands: Array2<f64>,
    /// The number of the record, from 0.
    pub index: usize,
    /// Samples since the first record began.
    pub start: usize,
    pub sample_rate_hz: f64,
}

impl Planned {
    /// Returns the number of samples from the beginning of the first record to the end of this one.
    pub(crate) fn end(&self) -> usize {
        self.start + self.commands.nrows()
    }

    /// Returns the record cut to its first `samples` samples.
    pub(crate) fn excerpt(&self, samples: usize) -> Self {
        let commands = self.commands.slice(s![..samples.min(self.commands.nrows()), ..]).to_owned();
        Self { commands, ..*self }
    }
}

/// The number of the highest line of the multisine is at least this, however short the period is.
const LEAST_HIGHEST: usize = 9;
const PERIODS: usize = 6;

/// Returns the records of a case, followed by the held-out one.
pub(crate) fn schedule(seed: u64, spec: &GapSpec, rig: &Rig) -> Vec<Planned> {
    let samples = |full: usize| (full as f64 * spec.length).round() as usize;
    let random = |level_v| (Excitation::Random { level_v }, samples(6400));
    let period = prime_from(samples(PERIOD));
    let plan = match spec.experiment {
        Experiment::Active => vec![
            (Excitation::Zero, samples(3200)),
            random(1.0),
            random(0.3),
            (Excitation::Periodic { period }, PERIODS * period),
            random(0.6),
            random(1.0),
            random(1.0),
        ],
        Experiment::Passive => vec![(Excitation::Random { level_v: 1.0 }, samples(2 * 6400)), random(1.0)],
    };
    let dac = Converter { step_v: 10.0 / 4096.0, range_v: 5.0 };
    let mut start = 0;
    plan.into_iter()
        .enumerate()
        .map(|(index, (excitation, samples))| {
            let mut commands = Array2::zeros((samples, INPUTS));
            for j in 0..spec.channels.inputs {
                let rng = stream(seed, Purpose::Excitation, (index << 8) | j);
                let signal = match excitation {
                    Excitation::Zero => vec![0.0; samples],
                    Excitation::Random { level_v } => {
                        low_passed(level_v, rig.band_hz, rng, samples, rig.sample_rate_hz)
                    }
                    Excitation::Periodic { period } => {
                        multisine(period, &lines(rig.lines, period, seed, index), rng, samples)
                    }
                };
                commands.column_mut(j).iter_mut().zip(signal).for_each(|(to, value)| *to = value);
            }
            let (commands, sample_rate_hz) = (convert(dac, commands).0, rig.sample_rate_hz);
            let planned = Planned { excitation, commands, index, start, sample_rate_hz };
            start += samples;
            planned
        })
        .collect()
}

fn prime_from(least: usize) -> usize {
    let is_prime = |n: &usize| (2..).take_while(|d| d * d <= *n).all(|d| !n.is_multiple_of(d));
    (least.max(2)..).find(is_prime).expect("there are infinitely many")
}

/// Returns the odd lines, except for one of every five, which is left out at random. A response at a line that is
/// left out is not caused by that line itself.
fn lines(full: [usize; 2], period: usize, seed: u64, index: usize) -> Vec<usize> {
    let mut rng = stream(seed, Purpose::Excitation, (index << 8) | INPUTS);
    let [lowest, highest] = full.map(|line| line * period / PERIOD);
    let odd: Vec<usize> = (lowest | 1..=highest.max(LEAST_HIGHEST)).step_by(2).collect();
    odd.chunks(5)
        .flat_map(|group| {
            let left_out = rng.random_range(0..group.len());
            group.iter().enumerate().filter(move |(i, _)| *i != left_out).map(|(_, line)| *line)
        })
        .collect()
}

fn multisine(period: usize, lines: &[usize], mut rng: rand_chacha::ChaCha12Rng, samples: usize) -> Vec<f64> {
    let phases: Vec<f64> = lines.iter().map(|_| 2.0 * PI * rng.random::<f64>()).collect();
    let at = |k: usize| -> f64 {
        // The product modulo the period keeps the angle small, and gives every period the same bits.
        let angle = |line: usize| 2.0 * PI * ((k * line) % period) as f64 / period as f64;
        lines.iter().zip(&phases).map(|(line, phase)| (angle(*line) + phase).cos()).sum()
    };
    let one = scaled_to((0..period).map(at).collect(), 1.0);
    (0..samples).map(|k| one[k % period]).collect()
}
