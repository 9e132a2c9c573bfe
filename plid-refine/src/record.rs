//! Training records, and their channels scaled to unit RMS.

use nalgebra::{DMatrix, DVector};
use ndarray::{Array2, ArrayView2};

use crate::error::RefineError;

/// The initial state of a record.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Start {
    /// The state at the first sample is zero.
    Rest,
    /// The state at the first sample is unknown and is estimated.
    #[default]
    Unknown,
}

/// A training record.
#[derive(Clone, Copy, Debug)]
pub struct Record<'a> {
    /// Inputs (samples x m).
    pub inputs: ArrayView2<'a, f64>,
    /// Outputs (samples x p); NaN marks a missing sample.
    pub outputs: ArrayView2<'a, f64>,
    /// The initial state.
    pub start: Start,
}

impl<'a> Record<'a> {
    /// Returns the number of samples.
    pub fn samples(&self) -> usize {
        self.inputs.nrows()
    }

    /// Returns samples `from..to`. A range that does not start with the record has an unknown initial state.
    #[must_use]
    pub fn range(&self, from: usize, to: usize) -> Record<'a> {
        Record {
            inputs: self.inputs.slice_move(ndarray::s![from..to, ..]),
            outputs: self.outputs.slice_move(ndarray::s![from..to, ..]),
            start: if from == 0 { self.start } else { Start::Unknown },
        }
    }
}

/// A record whose channels have unit RMS.
pub(crate) struct Scaled {
    pub inputs: Array2<f64>,
    pub outputs: Array2<f64>,
    pub start: Start,
}

impl Scaled {
    pub fn record(&self) -> Record<'_> {
        Record { inputs: self.inputs.view(), outputs: self.outputs.view(), start: self.start }
    }
}

/// Records scaled to unit RMS, with the divisors of their channels.
pub(crate) struct Data {
    pub records: Vec<Scaled>,
    pub input_scale: Vec<f64>,
    pub output_scale: Vec<f64>,
}

impl Data {
    /// Scales the records.
    ///
    /// # Errors
    /// Returns an error for a record that is empty or has a different number of channels, a value that is not finite,
    /// or a channel that is zero or missing throughout.
    pub fn new(records: &[Record<'_>]) -> Result<Self, RefineError> {
        let first = records.first().ok_or(RefineError::NoRecords)?;
        let (m, p) = (first.inputs.ncols(), first.outputs.ncols());
        for (number, record) in records.iter().enumerate() {
            check(record, number, m, p)?;
        }
        let size = |channel: &dyn Fn(&Record<'_>) -> (f64, usize)| {
            let (sum, count) = records.iter().map(channel).fold((0.0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
            (sum / count.max(1) as f64).sqrt()
        };
        let square = |column: ndarray::ArrayView1<'_, f64>| {
            column.iter().filter(|x| !x.is_nan()).fold((0.0, 0), |(s, n), x| (s + x * x, n + 1))
        };
        let input_scale: Vec<f64> = (0..m).map(|j| size(&|r| square(r.inputs.column(j)))).collect();
        let output_scale: Vec<f64> = (0..p).map(|i| size(&|r| square(r.outputs.column(i)))).collect();
        for (what, scales) in [("the input", &input_scale), ("the output", &output_scale)] {
            if let Some(channel) = scales.iter().position(|s| !(*s > 0.0)) {
                return Err(RefineError::EmptyChannel { what, channel });
            }
        }
        let divided = |array: ArrayView2<'_, f64>, scales: &[f64]| {
            Array2::from_shape_fn(array.dim(), |(k, j)| array[(k, j)] / scales[j])
        };
        let scaled = |r: &Record<'_>| Scaled {
            inputs: divided(r.inputs, &input_scale),
            outputs: divided(r.outputs, &output_scale),
            start: r.start,
        };
        Ok(Self { records: records.iter().map(scaled).collect(), input_scale, output_scale })
    }

    pub fn m(&self) -> usize {
        self.input_scale.len()
    }

    pub fn p(&self) -> usize {
        self.output_scale.len()
    }

    /// Returns the map from scaled outputs to the records' units.
    pub fn output_map(&self) -> DMatrix<f64> {
        DMatrix::from_diagonal(&DVector::from_column_slice(&self.output_scale))
    }

    /// Returns the number of samples present for each output.
    pub fn present(&self) -> Vec<usize> {
        let there = |i: usize| {
            let of = |r: &Scaled| r.outputs.column(i).iter().filter(|y| !y.is_nan()).count();
            self.records.iter().map(of).sum()
        };
        (0..self.p()).map(there).collect()
    }
}

fn check(record: &Record<'_>, number: usize, m: usize, p: usize) -> Result<(), RefineError> {
    let shape = |what, unit, expected, found| Err(RefineError::Shape { record: number, what, unit, expected, found });
    if record.inputs.ncols() != m || m == 0 {
        return shape("the input", "channels", m.max(1), record.inputs.ncols());
    }
    if record.outputs.ncols() != p || p == 0 {
        return shape("the output", "channels", p.max(1), record.outputs.ncols());
    }
    if record.outputs.nrows() != record.inputs.nrows() {
        return shape("the output", "samples", record.inputs.nrows(), record.outputs.nrows());
    }
    let bad_input = record.inputs.indexed_iter().find(|(_, x)| !x.is_finite()).map(|(at, _)| ("the input", at));
    let bad_output = record.outputs.indexed_iter().find(|(_, x)| x.is_infinite()).map(|(at, _)| ("the output", at));
    match bad_input.or(bad_output) {
        Some((what, (sample, channel))) => Err(RefineError::NotFinite { record: number, what, channel, sample }),
        None => Ok(()),
    }
}
