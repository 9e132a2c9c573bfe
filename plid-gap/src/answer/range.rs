//! The range of inputs and motion to which a simulation with effects was fitted, and how far a new input exceeds it.

use serde::{Deserialize, Serialize};

use crate::case::record::{Record, rms};
use crate::plant::Plant;
use crate::prepare::port_motion;

/// Largest excess over the range that is stated. For an input that was never driven, the excess would be infinite.
const MOST_TIMES: f64 = 1e3;

/// Sizes in the fitted records, the largest over all of them. Motion is that of the linear simulation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FittedRange {
    /// RMS of each input.
    pub input_rms: Vec<f64>,
    /// Peak displacement at each port, in the order of the ports.
    pub displacement_peak: Vec<f64>,
    /// Peak of each measured output.
    pub output_peak: Vec<f64>,
    /// Relative gap that the simulation with its effects leaves beyond the noise.
    pub unexplained: f64,
}

/// How far a new input exceeds the range.
#[derive(Debug, Clone, PartialEq)]
pub struct Beyond {
    /// Excess as a multiple of the range; one within it.
    pub times: f64,
    /// The signal with the largest excess, in words.
    pub what: String,
}

impl FittedRange {
    /// Returns the range of these records. `stated` is the gap that is expected of them and `floor` that of their
    /// noise.
    pub fn of(plant: &Plant, records: &[Record], stated: f64, floor: f64) -> Self {
        let largest = |size: &dyn Fn(&Record) -> Vec<f64>, count: usize| {
            records.iter().map(size).fold(vec![0.0_f64; count], |mut most, sizes| {
                most.iter_mut().zip(sizes).for_each(|(most, size)| *most = most.max(size));
                most
            })
        };
        Self {
            input_rms: largest(&|record| record.u.iter().map(rms).collect(), plant.m),
            displacement_peak: largest(&|record| displacement_peaks(plant, &record.u), plant.ports.len()),
            output_peak: largest(&|record| record.y.iter().map(|y| peak(y)).collect(), plant.p),
            unexplained: (stated * stated - floor * floor).max(0.0).sqrt(),
        }
    }

    /// Returns how far an input (m channels) exceeds the range.
    pub fn beyond(&self, plant: &Plant, inputs: &[String], u: &[Vec<f64>]) -> Beyond {
        let level = u
            .iter()
            .zip(&self.input_rms)
            .zip(inputs)
            .map(|((u, &fitted), name)| (format!("input `{name}`"), rms(u), fitted));
        let motion = displacement_peaks(plant, u);
        let motion = motion.into_iter().zip(&self.displacement_peak).zip(&plant.ports);
        let motion = motion.map(|((now, &fitted), port)| (format!("motion at `{}`", port.name), now, fitted));
        let times = |now: f64, fitted: f64| if now > 0.0 { (now / fitted).min(MOST_TIMES) } else { 0.0 };
        let within = Beyond { times: 1.0, what: String::new() };
        level.chain(motion).fold(within, |most, (what, now, fitted)| {
            let times = times(now, fitted);
            if times > most.times { Beyond { times, what } } else { most }
        })
    }
}

fn displacement_peaks(plant: &Plant, u: &[Vec<f64>]) -> Vec<f64> {
    port_motion(plant, u).iter().step_by(2).map(|displacement| peak(displacement)).collect()
}

/// Returns the peak of a channel; missing samples (NaN) do not count.
pub(crate) fn peak(x: &[f64]) -> f64 {
    x.iter().fold(0.0, |most: f64, x| most.max(x.abs()))
}
