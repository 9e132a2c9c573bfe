//! The range of inputs and motion to which a simulation with effects was fitted, and the excess of a new input over
//! it.

use serde::{Deserialize, Serialize};

use crate::answer::predict::Prediction;
use crate::case::record::{Channels, Record, rms};
use crate::judge::gap;
use crate::plant::Plant;
use crate::prepare::port_motion;

/// Upper bound of the excess over the range. For an input that was never driven, the excess would otherwise be
/// infinite.
const MOST_TIMES: f64 = 1e3;

/// Typical ratio between the sizes of a signal in records of one level; the peaks of a motion vary most. A smaller
/// excess does not deserve a warning.
const JUST_BEYOND: f64 = 1.25;

/// Sizes of the signals in the fitted records; each is the largest over all records. The motion is that of the linear
/// simulation, or that of a simulator in the loop with its effects.
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

/// The excess of a new input over the range.
#[derive(Debug, Clone, PartialEq)]
pub struct Beyond {
    /// The largest size as a multiple of the range; one within the range.
    pub times: f64,
    /// The signal with the largest excess, in words; empty within the range.
    pub what: String,
}

impl Beyond {
    /// Returns whether the excess is larger than the variation between records of one level.
    pub fn is_clear(&self) -> bool {
        self.times > JUST_BEYOND
    }

    /// Returns the share of the effects' correction that is uncertain. A law holds beyond the fitted range as well,
    /// although with less certainty. If the excess is clear, nothing is known of a curve without a law.
    fn uncertain(&self, is_curve: bool) -> f64 {
        if is_curve && self.is_clear() { 1.0 } else { 1.0 - 1.0 / self.times }
    }

    /// Returns the warning of a clear excess.
    pub fn warning(&self) -> Option<String> {
        let Self { times, what } = self;
        let far = if *times < MOST_TIMES { format!("{times:.1} times") } else { "far beyond".to_string() };
        self.is_clear().then(|| format!("extrapolation: {what} is {far} that of the fitted records"))
    }
}

impl FittedRange {
    /// Returns the range of these records, with the peak displacements at the ports in each of them. `stated` is the
    /// gap that is expected on held-out records, and `floor` the gap of the noise.
    pub fn of(records: &[Record], displacement_peaks: &[Vec<f64>], stated: f64, floor: f64) -> Self {
        let inputs: Vec<Vec<f64>> = records.iter().map(|record| record.u.iter().map(rms).collect()).collect();
        let outputs: Vec<Vec<f64>> = records.iter().map(|record| record.y.iter().map(|y| peak(y)).collect()).collect();
        Self {
            input_rms: largest(&inputs),
            displacement_peak: largest(displacement_peaks),
            output_peak: largest(&outputs),
            unexplained: (stated * stated - floor * floor).max(0.0).sqrt(),
        }
    }

    /// Returns the excess of inputs (m channels), with these peak displacements at the ports, over the range.
    pub fn beyond<'n>(
        &self,
        inputs: impl IntoIterator<Item = &'n String>,
        u: &[Vec<f64>],
        ports: impl IntoIterator<Item = &'n String>,
        displacement_peaks: &[f64],
    ) -> Beyond {
        let level = inputs.into_iter().zip(u).zip(&self.input_rms);
        let level = level.map(|((name, u), &fitted)| (format!("input `{name}`"), rms(u), fitted));
        let motion = ports.into_iter().zip(displacement_peaks).zip(&self.displacement_peak);
        let motion = motion.map(|((name, &now), &fitted)| (format!("motion at `{name}`"), now, fitted));
        let times = |now: f64, fitted: f64| if now > 0.0 { (now / fitted).min(MOST_TIMES) } else { 0.0 };
        let within = Beyond { times: 1.0, what: String::new() };
        level.chain(motion).fold(within, |most, (what, now, fitted)| {
            let times = times(now, fitted);
            if times > most.times { Beyond { times, what } } else { most }
        })
    }

    /// Checks that a range from a file has a size for each of m inputs, of the ports, and of p outputs.
    ///
    /// # Errors
    /// Returns a sentence that names the key.
    pub(crate) fn require_sizes(&self, m: usize, ports: usize, p: usize) -> Result<(), String> {
        require_sizes("fitted.input_rms", &self.input_rms, m)?;
        require_sizes("fitted.displacement_peak", &self.displacement_peak, ports)?;
        require_sizes("fitted.output_peak", &self.output_peak, p)?;
        require_sizes("fitted.unexplained", &[self.unexplained], 1)
    }
}

/// Checks that a list from a file consists of `count` nonnegative numbers.
///
/// # Errors
/// Returns a sentence that names the key.
pub(crate) fn require_sizes(key: &str, list: &[f64], count: usize) -> Result<(), String> {
    let is_size = |x: &f64| x.is_finite() && *x >= 0.0;
    if list.len() == count && list.iter().all(is_size) {
        return Ok(());
    }
    Err(format!("`{key}` must contain {count} nonnegative numbers"))
}

/// Returns the relative gap that a prediction is expected to have, with these outputs and RMS of their noise. The
/// squares of three parts add up: the noise; the gap that the fitted records left beyond the noise, multiplied by the
/// excess `times` of the input over them; and the share 1 - 1 / times of the effects' correction. If one of the effects
/// is a curve without a law (`is_curve`), the whole correction counts where the excess is clear. `None` if an output is
/// zero, because no gap can be relative to it.
pub(crate) fn expected_gap(
    fitted: Option<&FittedRange>,
    noise_rms: &[f64],
    prediction: &Prediction,
    outputs: &[Vec<f64>],
    is_curve: bool,
) -> Option<f64> {
    let sizes: Vec<f64> = outputs.iter().map(rms).collect();
    if sizes.contains(&0.0) {
        return None;
    }
    let times = prediction.beyond.as_ref().map_or(1.0, |beyond| beyond.times);
    let left = fitted.map_or(0.0, |fitted| times * fitted.unexplained);
    let share = prediction.beyond.as_ref().map_or(0.0, |beyond| beyond.uncertain(is_curve));
    let extrapolated = |(correction, size): (&Vec<f64>, &f64)| (share * rms(correction) / size).powi(2);
    let extrapolated: f64 =
        prediction.correction.iter().zip(&sizes).map(extrapolated).sum::<f64>() / sizes.len() as f64;
    let noise = gap::floor(noise_rms, outputs);
    Some((noise * noise + left * left + extrapolated).sqrt()).filter(|gap| gap.is_finite())
}

/// Returns the peak displacement at each port of a linear simulation.
pub(crate) fn displacement_peaks(plant: &Plant, u: &[Vec<f64>]) -> Vec<f64> {
    port_motion(plant, u).iter().step_by(2).map(|displacement| peak(displacement)).collect()
}

/// Returns the change of the outputs (p channels) that effects cause.
pub(crate) fn difference(with: &[Vec<f64>], without: &[Vec<f64>]) -> Channels {
    with.iter().zip(without).map(|(a, b)| a.iter().zip(b).map(|(a, b)| a - b).collect()).collect()
}

/// Returns the peak of a channel; missing samples (NaN) do not count.
pub(crate) fn peak(x: &[f64]) -> f64 {
    x.iter().fold(0.0, |most: f64, x| most.max(x.abs()))
}

/// Returns the maximum of each size over all records.
fn largest(sizes: &[Vec<f64>]) -> Vec<f64> {
    let count = sizes.first().map_or(0, Vec::len);
    (0..count).map(|at| sizes.iter().map(|of| of[at]).fold(0.0, f64::max)).collect()
}
