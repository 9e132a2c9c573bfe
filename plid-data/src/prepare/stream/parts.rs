//! A prepared record, block by block.

use super::super::trend::Line;
use super::source::{RawBlocks, Source};
use crate::DataError;
use ndarray::{Array1, Array2, Axis, concatenate, s};

/// Consecutive samples of a prepared record.
#[derive(Clone, Debug)]
pub struct Part {
    /// Inputs (rows x m), which are advanced if the preparation advances them.
    pub inputs: Array2<f64>,
    /// Outputs (rows x p); NaN where a sample is missing.
    pub outputs: Array2<f64>,
}

impl Part {
    /// Returns samples `from..to` of the part.
    pub fn range(&self, from: usize, to: usize) -> Self {
        let rows = s![from..to, ..];
        Self { inputs: self.inputs.slice(rows).to_owned(), outputs: self.outputs.slice(rows).to_owned() }
    }
}

/// The conversion that the preparation applies to each sample.
#[derive(Clone, Debug)]
pub(super) struct Conversion {
    /// Offsets of inputs and outputs.
    pub lines: [Vec<Line>; 2],
    /// Divisors of inputs and outputs.
    pub scales: [Vec<f64>; 2],
    /// Whether the inputs are advanced.
    pub advanced: bool,
}

impl Conversion {
    fn apply(&self, side: usize, values: &mut Array2<f64>) {
        for (i, mut column) in values.columns_mut().into_iter().enumerate() {
            let (offset, scale) = (self.lines[side][i].offset, self.scales[side][i]);
            column.mapv_inplace(|value| (value - offset) / scale);
        }
    }
}

/// The samples of a prepared record in their order.
pub struct Parts<'a> {
    raw: RawBlocks<'a>,
    conversion: Conversion,
    /// The last outputs of the present block, whose advanced inputs are in the next block.
    last: Option<Vec<f64>>,
    /// Number of samples that are still to be left out at the beginning.
    skip: usize,
}

impl<'a> Parts<'a> {
    pub(super) fn open(source: &'a Source, conversion: Conversion, skip: usize) -> Result<Self, DataError> {
        Ok(Self { raw: RawBlocks::open(source)?, conversion, last: None, skip })
    }

    /// Returns the next samples; `None` after the last ones.
    ///
    /// # Errors
    /// Returns the errors of [`crate::Blocks::next_block`] and of [`crate::channels`].
    pub fn next_part(&mut self) -> Result<Option<Part>, DataError> {
        loop {
            let Some(mut raw) = self.raw.next()? else { return Ok(None) };
            self.conversion.apply(0, &mut raw.inputs);
            self.conversion.apply(1, &mut raw.outputs);
            let part = if self.conversion.advanced {
                self.advance(raw.inputs, &raw.outputs)
            } else {
                Part { inputs: raw.inputs, outputs: raw.outputs }
            };
            let rows = part.inputs.nrows();
            let left_out = self.skip.min(rows);
            self.skip -= left_out;
            match left_out {
                0 if rows > 0 => return Ok(Some(part)),
                some if some < rows => return Ok(Some(part.range(some, rows))),
                _ => {}
            }
        }
    }

    /// Pairs each output with the next input. The last output waits for the next block.
    fn advance(&mut self, inputs: Array2<f64>, outputs: &Array2<f64>) -> Part {
        let rows = outputs.nrows();
        let kept = outputs.slice(s![..rows - 1, ..]);
        let last = self.last.replace(outputs.row(rows - 1).to_vec());
        match last {
            None => Part { inputs: inputs.slice(s![1.., ..]).to_owned(), outputs: kept.to_owned() },
            Some(row) => {
                let row = Array1::from(row).insert_axis(Axis(0));
                Part { inputs, outputs: concatenate![Axis(0), row, kept] }
            }
        }
    }

    /// Returns the prepared outputs of the last sample, which an advanced input does not reach; `None` if the inputs
    /// are not advanced.
    pub fn last_output(&self) -> Option<&[f64]> {
        self.last.as_deref()
    }
}
