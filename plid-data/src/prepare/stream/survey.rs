//! The first pass over a file: its length, its sample rate, and whether its channels can be used.

use super::source::{RawBlocks, Source};
use crate::checks::judge_constant;
use crate::rate::{rate_of_line, stated_rate, time_column};
use crate::select::judge_missing;
use crate::{DataError, Table, Warning};
use ndarray::ArrayView1;
use std::collections::BTreeMap;

/// The properties of a record that are known after the first pass.
pub(super) struct Survey {
    pub samples: usize,
    /// Whether any output has a missing sample.
    pub has_missing: bool,
    pub rate: Rate,
    pub warnings: Vec<Warning>,
    /// RMS of every column about its mean.
    pub channel_rms: BTreeMap<String, f64>,
}

/// The sample rate, or the column of time from which it follows.
pub(super) enum Rate {
    Stated(f64),
    Assumed,
    Times(TimeLine),
}

/// A column of time, whose values must lie near the straight line from the first time to the last.
#[derive(Clone, Debug)]
pub(super) struct TimeLine {
    column: String,
    unit_s: f64,
    first: f64,
    /// The last time that has been read.
    last: f64,
    /// Number of times that have been read.
    count: usize,
    off_the_line: f64,
    /// The last time of the preceding block in the second pass.
    before: Option<f64>,
    /// The step that differs most from the mean step, and the place of its later sample.
    worst: (f64, String),
}

impl Survey {
    /// Reads the whole file. `tell` receives the number of samples read.
    pub fn of(source: &Source, tell: &mut dyn FnMut(usize)) -> Result<Self, DataError> {
        let mut blocks = RawBlocks::open(source)?;
        let (mut samples, mut rate) = (0, Rate::Assumed);
        let mut missing = vec![0; source.outputs.len()];
        let mut all: Vec<(String, Spread)> = Vec::new();
        while let Some(block) = blocks.next()? {
            let table = &block.table;
            if samples == 0 {
                all = table.names.iter().map(|name| (name.clone(), Spread::default())).collect();
                rate = match (stated_rate(table, source.rate_hz)?, time_column(table)) {
                    (Some(rate), _) => Rate::Stated(rate),
                    (None, Some((name, unit_s))) => Rate::Times(TimeLine::new(name, unit_s)),
                    (None, None) => Rate::Assumed,
                };
            }
            if let Rate::Times(times) = &mut rate {
                times.follow(table)?;
            }
            for ((_, spread), column) in all.iter_mut().zip(table.columns.columns()) {
                spread.add(column);
            }
            for (missing, column) in missing.iter_mut().zip(block.outputs.columns()) {
                *missing += column.iter().filter(|v| v.is_nan()).count();
            }
            samples += table.samples();
            tell(samples);
        }
        if samples < 2 {
            return Err(DataError::OneSample { file: source.file.clone() });
        }
        let mut warnings = Vec::new();
        if matches!(rate, Rate::Assumed) {
            warnings.push(Warning::RateAssumed { file: source.file.display().to_string() });
        }
        warnings.extend(judge_missing(&source.file, &source.outputs, &missing, samples)?);
        let is_constant = |name: &String| all.iter().any(|(n, spread)| n == name && !spread.changes);
        let constant = |names: &[String]| names.iter().filter(|name| is_constant(name)).cloned().collect();
        let constant = [constant(&source.inputs), constant(&source.outputs)];
        warnings.extend(judge_constant(&source.file, constant, [source.inputs.len(), source.outputs.len()])?);
        let channel_rms = all.into_iter().map(|(name, spread)| (name, spread.rms())).collect();
        Ok(Self { samples, has_missing: missing.iter().any(|&count| count > 0), rate, warnings, channel_rms })
    }
}

/// Sums of a column about its first value.
#[derive(Clone, Default)]
struct Spread {
    /// The first value that is not missing.
    first: Option<f64>,
    changes: bool,
    count: f64,
    sum: f64,
    squares: f64,
}

impl Spread {
    fn add(&mut self, column: ArrayView1<'_, f64>) {
        for &value in column.iter().filter(|v| !v.is_nan()) {
            let first = *self.first.get_or_insert(value);
            self.changes |= value != first;
            let from_first = value - first;
            if from_first.is_finite() {
                self.count += 1.0;
                self.sum += from_first;
                self.squares += from_first * from_first;
            }
        }
    }

    /// Returns the RMS about the mean.
    fn rms(&self) -> f64 {
        let count = self.count.max(1.0);
        (self.squares / count - (self.sum / count).powi(2)).max(0.0).sqrt()
    }
}

impl TimeLine {
    fn new(column: &str, unit_s: f64) -> Self {
        let worst = (f64::NAN, String::new());
        let (first, last) = (f64::NAN, f64::NAN);
        Self { column: column.into(), unit_s, first, last, count: 0, off_the_line: 0.0, before: None, worst }
    }

    /// Returns the times of a block, which must all be finite.
    fn times<'t>(&self, table: &'t Table) -> Result<ArrayView1<'t, f64>, DataError> {
        let times = table.column(&self.column).unwrap_or_else(|| ArrayView1::from(&[]));
        let Some(k) = times.iter().position(|t| !t.is_finite()) else { return Ok(times) };
        let (file, channel) = (table.source.clone(), self.column.clone());
        Err(DataError::NotFinite { file, channel, at: table.place(k), value: times[k] })
    }

    /// Takes the times of the next block. This first pass finds the line.
    fn follow(&mut self, table: &Table) -> Result<(), DataError> {
        let times = self.times(table)?;
        if self.count == 0 {
            self.first = times.first().copied().unwrap_or(f64::NAN);
        }
        self.last = times.last().copied().unwrap_or(self.last);
        self.count += times.len();
        Ok(())
    }

    fn step(&self) -> f64 {
        (self.last - self.first) / (self.count - 1) as f64
    }

    /// Compares the times of a block with the line in the second pass.
    pub fn compare(&mut self, table: &Table) -> Result<(), DataError> {
        let (times, step) = (self.times(table)?, self.step());
        for (k, time) in times.iter().enumerate() {
            let off = (time - self.first - (table.first + k) as f64 * step).abs();
            self.off_the_line = self.off_the_line.max(off);
            if let Some(before) = self.before {
                let own = time - before;
                // A comparison with NaN is false.
                if !((own - step).abs() <= (self.worst.0 - step).abs()) {
                    self.worst = (own, table.place(k));
                }
            }
            self.before = Some(*time);
        }
        Ok(())
    }

    /// Returns the rate in Hz after the second pass.
    pub fn rate(&self, source: &Source) -> Result<f64, DataError> {
        let step = self.step();
        let rate = rate_of_line(step, self.off_the_line, self.count - 1, self.unit_s);
        rate.ok_or_else(|| DataError::UnevenTime {
            file: source.file.clone(),
            column: self.column.clone(),
            at: self.worst.1.clone(),
            step_s: self.worst.0 * self.unit_s,
            expected_s: step * self.unit_s,
        })
    }
}
