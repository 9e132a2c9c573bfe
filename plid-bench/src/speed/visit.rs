//! The steps of one cell, timed one by one.

use std::time::Instant;

use plid_backends::on_threads;
use plid_catalogue::{ScalarName, VariantError};
use plid_core::{IdentifierError, Scalar};
use plid_model::signal::median;
use serde::{Deserialize, Serialize};

use super::allocated::allocated;
use super::cell::Cell;
use super::config::Config;
use super::cores::Cores;
use super::histogram::Histogram;
use super::limits::{Pass, passes, peak, time};
use crate::{Loop, Workload};

/// The result of a visit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Visit {
    /// Median time of a step in us.
    pub median_us: f64,
    /// Time of a pass over an N x N matrix in us, as the mean of one pass right before the steps and one right after
    /// them.
    pub pass_us: f64,
    /// Number of bytes that all threads allocate within the timed steps; `None` if the program does not count them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub allocated_bytes: Option<usize>,
    /// Number of times that the recursion failed and was restarted.
    pub restarts: usize,
    /// Times of all steps.
    pub times: Histogram,
}

/// Limits of one matrix size and scalar.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Limit {
    /// Time of a pass over the whole matrix in us.
    pub full_us: f64,
    /// Time of a pass over its lower triangle in us.
    pub triangle_us: f64,
}

/// A recursion that cannot be timed.
#[derive(Debug, thiserror::Error)]
pub enum VisitError {
    /// The recursion cannot be built.
    #[error(transparent)]
    Variant(#[from] VariantError),
    /// The system cannot provide the threads.
    #[error(transparent)]
    Threads(#[from] rayon::ThreadPoolBuildError),
    /// The recursion fails repeatedly.
    #[error("it fails again and again: {0}")]
    Fails(IdentifierError),
}

/// Number of failures within a visit that are tolerated.
const MOST_RESTARTS: usize = 3;
/// Largest number of single times that are stored for a visit.
const MOST_STEPS: usize = 100_000;

/// Visits a cell: measures a pass, warms up, times the steps, and measures another pass.
///
/// # Errors
/// Returns a [`VisitError`].
pub fn visit(cell: &Cell, workload: &Workload<'_>, cores: &Cores, config: &Config) -> Result<Visit, VisitError> {
    let build = || workload.recursion(cell.threaded());
    let timed = || {
        let pass = || one_pass(cell.variant.scalar, cell.joint_states());
        let before_us = pass();
        let mut visit = timed(build, config)?;
        visit.pass_us = 0.5 * (before_us + pass());
        Ok(visit)
    };
    if cell.threads == 1 {
        return cores.on(0, |_| timed());
    }
    let pinned = cores.clone();
    on_threads(cell.threads, move |thread| _ = pinned.pin_here(thread), timed)?
}

fn timed<'a>(mut build: impl FnMut() -> Result<Loop<'a>, VariantError>, config: &Config) -> Result<Visit, VisitError> {
    let least_steps = config.steps_a_visit();
    let mut times: Vec<u32> = Vec::with_capacity(MOST_STEPS.max(least_steps));
    let (mut allocated_bytes, mut restarts) = (allocated().map(|_| 0), 0);
    let mut elapsed_ns = 0;
    'anew: loop {
        let mut steps = build()?;
        for _ in 0..config.warm_up {
            if let Err(error) = steps.step() {
                restarts += 1;
                if restarts > MOST_RESTARTS { return Err(VisitError::Fails(error)) } else { continue 'anew }
            }
        }
        let before = allocated();
        let since = |sum: Option<usize>| Some(sum? + allocated()? - before?);
        while times.len() < least_steps
            || (times.len() < times.capacity() && (elapsed_ns as f64) < 1e6 * config.visit_ms)
        {
            let start = Instant::now();
            let result = steps.step();
            let time_ns = start.elapsed().as_nanos().min(u32::MAX.into()) as u32;
            if let Err(error) = result {
                allocated_bytes = since(allocated_bytes);
                restarts += 1;
                if restarts > MOST_RESTARTS { return Err(VisitError::Fails(error)) } else { continue 'anew }
            }
            times.push(time_ns);
            elapsed_ns += u64::from(time_ns);
        }
        allocated_bytes = since(allocated_bytes);
        break;
    }
    let histogram = Histogram::of(&times);
    Ok(Visit { median_us: median_us(&times), pass_us: f64::NAN, allocated_bytes, restarts, times: histogram })
}

/// Returns the median of times in ns, in us.
fn median_us(times: &[u32]) -> f64 {
    median(&times.iter().map(|&ns| f64::from(ns) / 1e3).collect::<Vec<f64>>())
}

/// Returns the time of a pass over an N x N matrix in us.
fn one_pass(scalar: ScalarName, size: usize) -> f64 {
    fn of<S: Scalar>(size: usize) -> f64 {
        let mut pass = Pass::<S>::new(size);
        1e6 * time(|| pass.full())
    }
    match scalar {
        ScalarName::F32 => of::<f32>(size),
        ScalarName::F64 => of::<f64>(size),
        ScalarName::DoubleDouble => of::<qd::Quad>(size),
    }
}

/// Measures passes over a matrix of this size.
pub fn limit(scalar: ScalarName, size: usize, cores: &Cores) -> Limit {
    let [full, triangle] = cores.on(0, |_| match scalar {
        ScalarName::F32 => passes::<f32>(size),
        ScalarName::F64 => passes::<f64>(size),
        ScalarName::DoubleDouble => passes::<qd::Quad>(size),
    });
    Limit { full_us: 1e6 * full, triangle_us: 1e6 * triangle }
}

/// Returns the speed in registers in 10^9 multiplications and additions per second.
pub fn peak_gflops(scalar: ScalarName, cores: &Cores) -> f64 {
    1e-9 * cores.on(0, |_| match scalar {
        ScalarName::F32 => peak::<f32>(),
        ScalarName::F64 => peak::<f64>(),
        ScalarName::DoubleDouble => peak::<qd::Quad>(),
    })
}

#[cfg(test)]
mod tests {
    use plid_catalogue::Variant;

    use super::*;
    use crate::{Noise, Record};

    const CONFIG: Config = Config { rounds: 2, visit_ms: 0.0, steps: 60, warm_up: 5, cores: None, cross: Vec::new() };

    #[test]
    fn a_visit_times_as_many_steps_as_asked_for() {
        let record = Record::truss(3, 0.1).unwrap();
        let workload = Workload::new(&record, 6, Noise::Diagonal).unwrap();
        let cell = Cell { states: 6, inputs: 3, noise: Noise::Diagonal, threads: 1, variant: Variant::default() };
        let visit = visit(&cell, &workload, &Cores::choose(None, 1), &CONFIG).unwrap();
        assert_eq!((visit.times.count(), visit.restarts), (30, 0));
        assert!(visit.median_us > 0.0 && visit.pass_us > 0.0);
        assert!((visit.times.quantile_us(0.5) / visit.median_us - 1.0).abs() < 0.5);
        // Tests have no counting allocator, so the visit states no allocations.
        assert_eq!(visit.allocated_bytes, None);
    }

    #[test]
    fn medians_are_of_single_steps() {
        assert_eq!(median_us(&[5000, 1000, 3000]), 3.0);
    }
}
