//! The operations of every filter here, and the loop that serves a comparison.

use std::error::Error;
use std::io::{BufRead, Write};
use std::path::Path;

use cpu_time::ProcessTime;

use crate::workload::{CHANNELS, Case, write_estimate};

/// Any failure of a crate, as its message.
pub type Failure = Box<dyn Error>;

/// The joint filter in somebody's library.
pub trait Peer {
    /// Takes an estimate (N) and its covariance (N x N, symmetric) as they stand before a sample.
    fn load(&mut self, s: &[f64], p: &[f64]) -> Result<(), Failure>;

    /// One step: the outputs z and the inputs u of a sample.
    fn step(&mut self, z: &[f64; CHANNELS], u: &[f64; CHANNELS]) -> Result<(), Failure>;

    /// The estimate, and the covariance column by column.
    fn estimate(&self) -> Result<(Vec<f64>, Vec<f64>), Failure>;
}

/// Takes `steps` samples and writes the estimate for comparison; then, for each number that comes in on standard input,
/// goes on from there by as many samples and answers with the seconds of the processor that it took.
pub fn serve(mut peer: impl Peer, case: &Case, steps: usize, directory: &Path, name: &str) -> Result<(), Failure> {
    peer.load(&case.settings.initial_estimate, &case.covariance)?;
    for k in 0..steps {
        let (z, u) = case.sample(k);
        peer.step(z, u)?;
    }
    let (s, p) = peer.estimate()?;
    write_estimate(directory, name, &s, &p)?;
    let mut out = std::io::stdout();
    writeln!(out, "ready")?;
    out.flush()?;
    for line in std::io::stdin().lock().lines() {
        let batch: usize = line?.trim().parse()?;
        peer.load(&s, &p)?;
        let start = ProcessTime::now();
        for k in steps..steps + batch {
            let (z, u) = case.sample(k);
            peer.step(z, u)?;
        }
        writeln!(out, "{}", start.elapsed().as_secs_f64())?;
        out.flush()?;
    }
    Ok(())
}
