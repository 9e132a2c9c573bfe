//! What inputs and motion a simulation with effects was fitted to, and what to expect of a prediction beyond them.

use serde::{Deserialize, Serialize};

use crate::case::record::{Record, rms};
use crate::plant::Plant;
use crate::prepare::port_motion;

/// Largest excess over the range that is stated. An input that was never driven would have none that is finite.
const MOST_TIMES: f64 = 1e3;

/// Of the records that were fitted. Sizes are the largest over them, motion is that of the linear simulation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FittedRange {
    /// RMS of each input.
    pub input_rms: Vec<f64>,
    /// Peak displacement at each port, as the ports are ordered.
    pub displacement_peak: Vec<f64>,
    /// Peak of each measured output.
    pub output_peak: Vec<f64>,
    /// Relative gap that the simulation with its effects leaves beyond the noise.
    pub unexplained: f64,
}

/// How far a new input goes beyond the range.
#[derive(Debug, Clone, PartialEq)]
pub struct Beyond {
    /// Times the range; one within it.
    pub times: f64,
    /// In what, in words.
    pub what: String,
}

impl FittedRange {
    /// Of these records. `stated` is the gap that is expected of them and `floor` that of their noise.
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

    /// How far an input (m channels) goes beyond.
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

/// The largest size of a channel; missing samples (NaN) do not count.
pub(crate) fn peak(x: &[f64]) -> f64 {
    x.iter().fold(0.0, |most: f64, x| most.max(x.abs()))
}
