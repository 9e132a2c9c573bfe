//! Preparation of a record that is not held in memory.
//!
//! The file is read several times: for its length and its sample rate; for the means; for the divisors; then by the
//! caller, as [`Parts`]. Only a window is kept in memory: the samples around the end of the training part.

mod parts;
mod source;
mod survey;

pub use parts::{Part, Parts};
pub use source::Source;

use super::scaling::Scaling;
use super::trend::{Line, Trend};
use super::{Before, Preparation, PrepareError, Prepared, Step, last_steps};
use crate::{DataError, Record, Warning};
use ndarray::{Array2, ArrayView2, Axis, concatenate, s};
use parts::Conversion;
use source::{Raw, RawBlocks};
use std::collections::BTreeMap;
use std::ops::Range;
use survey::{Rate, Survey};

/// A prepared record in a file.
#[derive(Debug)]
pub struct Streamed {
    /// The range of samples of the prepared record that are in the window.
    pub window: Range<usize>,
    /// Number of samples of the prepared record.
    pub samples: usize,
    /// Number of its training samples.
    pub training: usize,
    /// Whether any output has a missing sample.
    pub has_missing: bool,
    /// Warnings on the file.
    pub warnings: Vec<Warning>,
    /// RMS of every column of the file about its mean, in the data's units.
    pub channel_rms: BTreeMap<String, f64>,
    source: Source,
    conversion: Conversion,
}

impl Streamed {
    /// Opens the prepared record at its sample `from`.
    ///
    /// # Errors
    /// Returns an error if the file cannot be read.
    pub fn parts(&self, from: usize) -> Result<Parts<'_>, DataError> {
        Parts::open(&self.source, self.conversion.clone(), from)
    }

    /// Returns the divisors of the outputs (p).
    pub fn output_scales(&self) -> &[f64] {
        &self.conversion.scales[1]
    }
}

/// Receives the name of a pass, the number of samples that have been read, and their total number, which is 0 while it
/// is not known.
pub type Tell<'a> = &'a mut dyn FnMut(&'static str, usize, usize);

/// Prepares a record as [`super::prepare`] does, with its leading share `training_share` for training. At most `window`
/// samples on each side of the end of the training part are held in memory. They are the first result, and are prepared
/// with the means and divisors of the whole training part. These samples decide whether the input is advanced, and
/// determine the bands.
///
/// # Errors
/// Returns the errors of [`super::prepare`] and of [`crate::select`], and [`PrepareError::NotInBlocks`] for a step that
/// needs the whole record.
pub fn prepare(
    source: Source,
    training_share: f64,
    preparation: &Preparation,
    window: usize,
    tell: Tell<'_>,
) -> Result<(Prepared, Streamed), PrepareError> {
    if let Some(step) = preparation.not_in_blocks() {
        return Err(PrepareError::NotInBlocks { step });
    }
    super::check_shares(&[training_share], 1)?;
    let survey = Survey::of(&source, &mut |done| tell("reading", done, 0))?;
    let cut = (training_share * survey.samples as f64).round() as usize;
    let held = cut.saturating_sub(window)..(cut + window).min(survey.samples);
    let training = cut - held.start;
    let (kept, means) = Second { source: &source, survey: &survey, cut, held: held.clone() }.read(tell)?;
    let lines = match preparation.trend {
        Trend::None => [vec![Line::default(); source.inputs.len()], vec![Line::default(); source.outputs.len()]],
        _ => means,
    };
    let mut conversion =
        Conversion { scales: [&lines[0], &lines[1]].map(|side| vec![1.0; side.len()]), lines, advanced: false };
    let steps = if preparation.trend == Trend::Mean { vec![Step::MeanRemoved] } else { Vec::new() };
    let before = Before { repeat_noise: Vec::new(), start_s: 0.0, steps, warnings: Vec::new() };
    let all_lines = vec![conversion.lines.clone()];
    let remove = |records: &mut [Record], _: &[usize]| {
        subtract(&mut records[0], &all_lines[0]);
        all_lines
    };
    let scale = |records: &mut [Record], _: &[usize], advanced: bool| {
        conversion.advanced = advanced;
        if preparation.scaling == Scaling::Rms {
            conversion.scales = divisors(&source, &conversion, cut.saturating_sub(advanced.into()), tell)?;
        }
        divide(&mut records[0], &conversion.scales);
        Ok(conversion.scales.clone())
    };
    // The trend is removed here, with the means of the whole training part.
    let rest = Preparation { trend: Trend::None, ..preparation.clone() };
    let window = last_steps((vec![kept], vec![training]), &rest, before, remove, scale)?;
    let advanced = window.advanced;
    let streamed = Streamed {
        window: held.start..held.start + window.records[0].samples(),
        samples: survey.samples - advanced,
        training: cut.saturating_sub(advanced),
        has_missing: survey.has_missing,
        warnings: survey.warnings,
        channel_rms: survey.channel_rms,
        source,
        conversion,
    };
    Ok((window, streamed))
}

/// The second pass over a file.
struct Second<'a> {
    source: &'a Source,
    survey: &'a Survey,
    /// End of the training part.
    cut: usize,
    /// The range of samples that are kept.
    held: Range<usize>,
}

impl Second<'_> {
    /// Returns the samples that are kept, and the means of the training part.
    fn read(self, tell: Tell<'_>) -> Result<(Record, [Vec<Line>; 2]), DataError> {
        let Self { source, survey, cut, held } = self;
        let mut sums = [vec![Sum::default(); source.inputs.len()], vec![Sum::default(); source.outputs.len()]];
        let (mut inputs, mut outputs) = (Vec::new(), Vec::new());
        let mut times = if let Rate::Times(times) = &survey.rate { Some(times.clone()) } else { None };
        let mut blocks = RawBlocks::open(source)?;
        while let Some(Raw { table, inputs: u, outputs: y }) = blocks.next()? {
            let (from, to) = (table.first, table.first + table.samples());
            if let Some(times) = &mut times {
                times.compare(&table)?;
            }
            let training = cut.clamp(from, to) - from;
            for (sums, values) in sums.iter_mut().zip([&u, &y]) {
                add(sums, values.slice(s![..training, ..]), |v| v);
            }
            let kept = s![held.start.clamp(from, to) - from..held.end.clamp(from, to) - from, ..];
            inputs.push(u.slice(kept).to_owned());
            outputs.push(y.slice(kept).to_owned());
            tell("means", to, survey.samples);
        }
        let whole = |parts: Vec<Array2<f64>>| {
            let views: Vec<ArrayView2<'_, f64>> = parts.iter().map(|part| part.view()).collect();
            concatenate(Axis(0), &views).map_err(|error| {
                let what = error.to_string();
                DataError::Malformed { file: source.file.clone(), what }
            })
        };
        let record = Record {
            sample_rate_hz: match (&survey.rate, times) {
                (_, Some(times)) => times.rate(source)?,
                (Rate::Stated(rate), None) => *rate,
                _ => 1.0,
            },
            input_names: source.inputs.clone(),
            output_names: source.outputs.clone(),
            inputs: whole(inputs)?,
            outputs: whole(outputs)?,
        };
        let line = |sum: &Sum| Line { offset: sum.mean(), slope_per_s: 0.0 };
        Ok((record, sums.map(|side| side.iter().map(line).collect())))
    }
}

/// A sum over the values that are not missing, in their order, so that it is identical to the bit to the sum over a
/// whole column.
#[derive(Clone, Copy, Default)]
struct Sum {
    sum: f64,
    count: usize,
}

impl Sum {
    fn mean(self) -> f64 {
        if self.count == 0 { 0.0 } else { self.sum / self.count as f64 }
    }
}

/// Adds the function `of` of each value to the sum of its column.
fn add(sums: &mut [Sum], values: ArrayView2<'_, f64>, of: fn(f64) -> f64) {
    for (sum, column) in sums.iter_mut().zip(values.columns()) {
        for &value in column.iter().filter(|v| !v.is_nan()) {
            sum.sum += of(value);
            sum.count += 1;
        }
    }
}

/// Makes the third pass over a file. Returns the RMS of each channel over the first `training` samples of the prepared
/// record.
fn divisors(
    source: &Source,
    conversion: &Conversion,
    training: usize,
    tell: Tell<'_>,
) -> Result<[Vec<f64>; 2], DataError> {
    let mut sums = [vec![Sum::default(); source.inputs.len()], vec![Sum::default(); source.outputs.len()]];
    let mut parts = Parts::open(source, conversion.clone(), 0)?;
    let mut done = 0;
    while done < training
        && let Some(part) = parts.next_part()?
    {
        let rows = part.inputs.nrows().min(training - done);
        for (sums, values) in sums.iter_mut().zip([&part.inputs, &part.outputs]) {
            add(sums, values.slice(s![..rows, ..]), |v| v * v);
        }
        done += rows;
        tell("divisors", done, training);
    }
    let rms = |sum: &Sum| sum.mean().sqrt();
    Ok(sums.map(|side| side.iter().map(rms).map(|size| if size > 0.0 { size } else { 1.0 }).collect()))
}

fn subtract(record: &mut Record, lines: &[Vec<Line>; 2]) {
    for (values, lines) in [&mut record.inputs, &mut record.outputs].into_iter().zip(lines) {
        for (mut column, line) in values.columns_mut().into_iter().zip(lines) {
            column.mapv_inplace(|v| v - line.offset);
        }
    }
}

fn divide(record: &mut Record, scales: &[Vec<f64>; 2]) {
    for (values, scales) in [&mut record.inputs, &mut record.outputs].into_iter().zip(scales) {
        for (mut column, scale) in values.columns_mut().into_iter().zip(scales) {
            column.mapv_inplace(|v| v / scale);
        }
    }
}

#[cfg(test)]
mod tests;
