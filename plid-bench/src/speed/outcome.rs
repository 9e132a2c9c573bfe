//! The results of a speed study: medians over the rounds and derived figures.

use std::collections::BTreeMap;

use plid_catalogue::{CovarianceName, ExpectationName, ScalarName, Variant};
use serde::{Deserialize, Serialize};

use super::cell::{Cell, OUTPUTS, word};
use super::config::Config;
use super::cores::Cores;
use super::count::Operations;
use super::histogram::Histogram;
use super::visit::{Limit, Visit};
use super::{Entry, Item, traffic};
use crate::Noise;
use crate::study::Machine;
use plid_model::signal::median;

/// All figures of a study, which are the content of speed.json.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// The machine.
    pub machine: Machine,
    /// The logical cores used, beginning with the one that measured. The list is empty if the system does not state
    /// them.
    pub cores: Vec<usize>,
    /// Whether the threads were pinned to these cores.
    pub pinned: bool,
    /// The config.
    pub config: Config,
    /// Cells that need more cores than the machine has.
    pub skipped: Vec<String>,
    /// The speeds of one core in registers.
    pub peaks: Vec<Peak>,
    /// The passes over matrices.
    pub limits: Vec<Limits>,
    /// The times of the steps.
    pub timings: Vec<Timing>,
    /// The growth of time and operations with N.
    pub slopes: Vec<Slope>,
}

/// The speed of one core in registers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Peak {
    /// The number type.
    pub scalar: ScalarName,
    /// Multiplications and additions in 10^9 per second, the best of the rounds.
    pub gflops: f64,
}

/// Passes over an N x N matrix.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Limits {
    /// Joint number of states and parameters N.
    pub joint_states: usize,
    /// The number type.
    pub scalar: ScalarName,
    /// Time to read and write the whole matrix in us.
    pub full_us: f64,
    /// Time to read and write its lower triangle in us.
    pub triangle_us: f64,
    /// Bytes read and written by the pass over the whole matrix, in 10^9 per second.
    pub gbytes_s: f64,
}

/// The steps of one cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Timing {
    /// The cell's name.
    pub key: String,
    /// The cell.
    pub cell: Cell,
    /// Joint number of states and parameters N.
    pub joint_states: usize,
    /// Number of timed steps.
    pub steps: u64,
    /// Median over the rounds of the median time of a step in us.
    pub median_us: f64,
    /// The smallest of these medians in us.
    pub least_us: f64,
    /// The time in us that 99 % of all steps do not exceed.
    pub p99_us: f64,
    /// The time in us that 99.9 % of all steps do not exceed.
    pub p99_9_us: f64,
    /// The longest step in us.
    pub longest_us: f64,
    /// Ratio of the time of a step to that of a pass over P in the same visit, for each round.
    pub pass_ratios: Vec<f64>,
    /// The median of these ratios.
    pub passes: f64,
    /// Number of bytes allocated within all timed steps; `None` if they were not counted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub allocated_bytes: Option<usize>,
    /// Number of times that the recursion failed and was restarted.
    pub restarts: usize,
    /// Operations of a step.
    pub operations: Operations,
    /// Bytes of P, its factors and their scratch that a step must read or write.
    pub bytes: f64,
    /// Operations in 10^9 per second.
    pub gflops: f64,
    /// These bytes in 10^9 per second.
    pub gbytes_s: f64,
}

/// The growth of time and operations with N, by least squares of the logarithms.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Slope {
    /// The recursion.
    pub variant: Variant,
    /// The sizes N.
    pub sizes: Vec<usize>,
    /// Slope of log time.
    pub time: f64,
    /// Slope of log operations.
    pub operations: f64,
}

/// The sizes over which slopes are computed.
const SLOPE_SIZES: std::ops::RangeInclusive<usize> = 168..=448;

impl Outcome {
    /// Returns the timing of a cell.
    pub fn timing(&self, cell: &Cell) -> Option<&Timing> {
        self.timings.iter().find(|timing| timing.cell == *cell)
    }

    /// Returns the timing of f64 on plain loops and one thread, with diagonal noise and three inputs and outputs.
    pub fn plain(&self, states: usize, covariance: CovarianceName, expectations: ExpectationName) -> Option<&Timing> {
        self.timing(&Cell::plain(states, covariance, expectations))
    }

    /// Returns the timing of that cell after `change`.
    pub fn of(
        &self,
        states: usize,
        covariance: CovarianceName,
        expectations: ExpectationName,
        change: impl FnOnce(&mut Cell),
    ) -> Option<&Timing> {
        let mut cell = Cell::plain(states, covariance, expectations);
        change(&mut cell);
        self.timing(&cell)
    }

    /// Returns the passes of a size and scalar.
    pub fn limits(&self, joint_states: usize, scalar: ScalarName) -> Option<&Limits> {
        self.limits.iter().find(|limits| limits.joint_states == joint_states && limits.scalar == scalar)
    }

    /// Returns the peak of a scalar in 10^9 operations per second.
    pub fn peak(&self, scalar: ScalarName) -> Option<f64> {
        self.peaks.iter().find(|peak| peak.scalar == scalar).map(|peak| peak.gflops)
    }

    /// Returns the smallest times in us that the measured limits permit on one thread, for the operations of a timing
    /// at the peak, and for its bytes at the rate of a pass over P.
    pub fn bounds_us(&self, timing: &Timing) -> Option<[f64; 2]> {
        let scalar = timing.cell.variant.scalar;
        let rate = self.limits(timing.joint_states, scalar)?.gbytes_s;
        Some([timing.operations.total() as f64 / (1e3 * self.peak(scalar)?), timing.bytes / (1e3 * rate)])
    }
}

/// A line of speed.csv.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    states: usize,
    inputs: usize,
    outputs: usize,
    joint_states: usize,
    covariance: String,
    expectations: String,
    backend: String,
    scalar: String,
    threads: usize,
    noise: String,
    steps: u64,
    median_us: f64,
    least_us: f64,
    p99_us: f64,
    p99_9_us: f64,
    longest_us: f64,
    passes: f64,
    allocated_bytes: Option<usize>,
    restarts: usize,
    flops: u64,
    bytes: f64,
    gflops: f64,
    gbytes_s: f64,
}

impl Outcome {
    /// Returns the lines of speed.csv.
    pub fn rows(&self) -> impl Iterator<Item = Row> {
        self.timings.iter().map(|timing| Row {
            states: timing.cell.states,
            inputs: timing.cell.inputs,
            outputs: OUTPUTS,
            joint_states: timing.joint_states,
            covariance: word(&timing.cell.variant.covariance),
            expectations: word(&timing.cell.variant.expectations),
            backend: word(&timing.cell.variant.backend),
            scalar: word(&timing.cell.variant.scalar),
            threads: timing.cell.threads,
            noise: word(&timing.cell.noise),
            steps: timing.steps,
            median_us: timing.median_us,
            least_us: timing.least_us,
            p99_us: timing.p99_us,
            p99_9_us: timing.p99_9_us,
            longest_us: timing.longest_us,
            passes: timing.passes,
            allocated_bytes: timing.allocated_bytes,
            restarts: timing.restarts,
            flops: timing.operations.total(),
            bytes: timing.bytes,
            gflops: timing.gflops,
            gbytes_s: timing.gbytes_s,
        })
    }
}

/// All measurements, by key, in the order of the rounds.
#[derive(Debug, Default)]
pub struct Found(BTreeMap<String, Vec<Entry>>);

impl Found {
    /// Adds the measurement of a round.
    pub fn take(&mut self, key: String, entry: Entry) {
        self.0.entry(key).or_default().push(entry);
    }

    fn all<'a, T: 'a>(&'a self, key: &str, pick: fn(&'a Entry) -> Option<T>) -> Vec<T> {
        self.0.get(key).into_iter().flatten().filter_map(pick).collect()
    }

    /// Returns the derived figures.
    pub fn outcome(
        &self,
        config: &Config,
        machine: Machine,
        cores: &Cores,
        items: &[Item],
        skipped: &[Cell],
    ) -> Outcome {
        let mut outcome = Outcome {
            machine,
            cores: cores.ids().to_vec(),
            pinned: cores.can_pin(),
            config: config.clone(),
            skipped: skipped.iter().map(Cell::key).collect(),
            peaks: Vec::new(),
            limits: Vec::new(),
            timings: Vec::new(),
            slopes: Vec::new(),
        };
        for item in items {
            match item {
                Item::Peak(scalar) => {
                    let rounds = self.all(&item.key(), |entry| match entry {
                        Entry::PeakGflops(gflops) => Some(*gflops),
                        _ => None,
                    });
                    let gflops = rounds.into_iter().fold(f64::NAN, f64::max);
                    outcome.peaks.push(Peak { scalar: *scalar, gflops });
                }
                Item::Limit(size, scalar) => {
                    let rounds = self.all(&item.key(), |entry| match entry {
                        Entry::Limit(limit) => Some(*limit),
                        _ => None,
                    });
                    outcome.limits.push(limits(*size, *scalar, &rounds));
                }
                Item::Cell(cell) => {
                    let visits = self.all(&item.key(), |entry| match entry {
                        Entry::Visit(visit) => Some(visit),
                        _ => None,
                    });
                    let operations = self.all(&cell.operations_key(), |entry| match entry {
                        Entry::Operations(operations) => Some(*operations),
                        _ => None,
                    });
                    outcome.timings.push(timing(cell, &visits, operations.first().copied().unwrap_or_default()));
                }
            }
        }
        outcome.slopes = slopes(&outcome.timings);
        outcome
    }
}

/// Returns the figures of a cell from its visits, of which there is one per round.
pub fn timing(cell: &Cell, visits: &[&Visit], operations: Operations) -> Timing {
    let mut times = Histogram::default();
    visits.iter().for_each(|visit| times.merge(&visit.times));
    let medians: Vec<f64> = visits.iter().map(|visit| visit.median_us).collect();
    let pass_ratios: Vec<f64> = visits.iter().map(|visit| visit.median_us / visit.pass_us).collect();
    let median_us = median(&medians);
    let bytes = traffic::bytes(cell);
    Timing {
        key: cell.key(),
        cell: *cell,
        joint_states: cell.joint_states(),
        steps: times.count(),
        median_us,
        least_us: medians.iter().copied().fold(f64::INFINITY, f64::min),
        p99_us: times.quantile_us(0.99),
        p99_9_us: times.quantile_us(0.999),
        longest_us: times.quantile_us(1.0),
        passes: median(&pass_ratios),
        pass_ratios,
        allocated_bytes: visits.iter().map(|visit| visit.allocated_bytes).sum(),
        restarts: visits.iter().map(|visit| visit.restarts).sum(),
        operations,
        bytes,
        gflops: operations.total() as f64 / (1e3 * median_us),
        gbytes_s: bytes / (1e3 * median_us),
    }
}

/// Returns the passes of a size from those of the rounds.
pub fn limits(joint_states: usize, scalar: ScalarName, rounds: &[Limit]) -> Limits {
    let of = |field: fn(&Limit) -> f64| median(&rounds.iter().map(field).collect::<Vec<_>>());
    let full_us = of(|limit| limit.full_us);
    let bytes = 2 * joint_states * joint_states * super::cell::scalar_bytes(scalar);
    let gbytes_s = bytes as f64 / (1e3 * full_us);
    Limits { joint_states, scalar, full_us, triangle_us: of(|limit| limit.triangle_us), gbytes_s }
}

/// Returns the slopes of every recursion that was timed at three or more sizes, with three inputs and outputs, one
/// thread and diagonal noise.
pub fn slopes(timings: &[Timing]) -> Vec<Slope> {
    let fits = |timing: &&Timing| {
        let cell = &timing.cell;
        (cell.inputs, cell.threads, cell.noise) == (3, 1, Noise::Diagonal) && SLOPE_SIZES.contains(&timing.joint_states)
    };
    let timings: Vec<&Timing> = timings.iter().filter(fits).collect();
    let mut slopes: Vec<Slope> = Vec::new();
    for variant in timings.iter().map(|timing| timing.cell.variant) {
        let same: Vec<&&Timing> = timings.iter().filter(|timing| timing.cell.variant == variant).collect();
        if same.len() < 3 || slopes.iter().any(|slope| slope.variant == variant) {
            continue;
        }
        let slope = |of: fn(&Timing) -> f64| {
            slope(&same.iter().map(|t| ((t.joint_states as f64).ln(), of(t).ln())).collect::<Vec<_>>())
        };
        slopes.push(Slope {
            variant,
            sizes: same.iter().map(|timing| timing.joint_states).collect(),
            time: slope(|timing| timing.median_us),
            operations: slope(|timing| timing.operations.total() as f64),
        });
    }
    slopes
}

/// Returns the slope of a line by least squares.
fn slope(points: &[(f64, f64)]) -> f64 {
    let count = points.len() as f64;
    let mean = |of: fn(&(f64, f64)) -> f64| points.iter().map(of).sum::<f64>() / count;
    let (x, y) = (mean(|p| p.0), mean(|p| p.1));
    let (product, square) =
        points.iter().fold((0.0, 0.0), |(p, s), point| (p + (point.0 - x) * (point.1 - y), s + (point.0 - x).powi(2)));
    product / square
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slopes() {
        let line: Vec<(f64, f64)> = (0..5).map(|k| (f64::from(k), 3.0 - 2.5 * f64::from(k))).collect();
        assert!((slope(&line) + 2.5).abs() < 1e-12);
    }

    #[test]
    fn a_cell_is_the_middle_of_its_rounds() {
        let visit = |median_us: f64, pass_us: f64, allocated_bytes| Visit {
            median_us,
            pass_us,
            allocated_bytes,
            restarts: 1,
            times: Histogram::of(&[(1e3 * median_us) as u32]),
        };
        let cell = Cell::plain(12, CovarianceName::Direct, ExpectationName::Prior);
        let visits = [visit(8.0, 2.0, Some(0)), visit(9.0, 3.0, Some(1)), visit(10.0, 2.0, Some(0))];
        let operations = Operations { additions: 9000, ..Operations::default() };
        let found = timing(&cell, &visits.iter().collect::<Vec<_>>(), operations);
        assert_eq!((found.median_us, found.least_us, found.passes), (9.0, 8.0, 4.0));
        assert_eq!((found.steps, found.restarts, found.allocated_bytes), (3, 3, Some(1)));
        assert!((found.gflops - 1.0).abs() < 1e-12);
        let uncounted = [visit(1.0, 1.0, Some(0)), visit(1.0, 1.0, None)];
        assert_eq!(timing(&cell, &uncounted.iter().collect::<Vec<_>>(), operations).allocated_bytes, None);
    }
}

/// Artificial outcomes for tests.
#[cfg(test)]
pub mod testing {
    use super::*;

    /// Returns a timing with these ratios to a pass of 10 us.
    pub fn timing(
        states: usize,
        covariance: CovarianceName,
        expectations: ExpectationName,
        pass_us: f64,
        ratios: &[f64],
    ) -> Timing {
        let cell = Cell::plain(states, covariance, expectations);
        let visits: Vec<Visit> = ratios
            .iter()
            .map(|ratio| {
                let median_us = ratio * pass_us;
                let times = Histogram::of(&[(1e3 * median_us) as u32]);
                Visit { median_us, pass_us, allocated_bytes: Some(0), restarts: 0, times }
            })
            .collect();
        let operations = Operations { additions: (cell.joint_states() as u64).pow(2), ..Operations::default() };
        super::timing(&cell, &visits.iter().collect::<Vec<_>>(), operations)
    }

    /// Returns an outcome of these timings on this machine.
    pub fn outcome(timings: Vec<Timing>) -> Outcome {
        let config = Config { rounds: 1, visit_ms: 0.0, steps: 1, warm_up: 1, cores: None, cross: Vec::new() };
        let mut limits: Vec<Limits> = Vec::new();
        for timing in &timings {
            let scalar = timing.cell.variant.scalar;
            let limit = Limit { full_us: 10.0, triangle_us: 5.0 };
            limits.push(super::limits(timing.joint_states, scalar, &[limit]));
        }
        Outcome {
            machine: Machine::here(),
            cores: vec![0],
            pinned: true,
            config,
            skipped: Vec::new(),
            peaks: vec![Peak { scalar: ScalarName::F64, gflops: 50.0 }],
            limits,
            slopes: slopes(&timings),
            timings,
        }
    }
}
