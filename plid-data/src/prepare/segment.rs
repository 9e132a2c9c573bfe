//! The part of a record that an estimate may use.
use crate::Record;
use ndarray::{ArrayView2, s};

/// Inputs and outputs of a stretch of samples.
#[derive(Debug, Clone, Copy)]
pub struct Segment<'a> {
    /// Inputs (K x m).
    pub inputs: ArrayView2<'a, f64>,
    /// Outputs (K x p); NaN where a sample is missing.
    pub outputs: ArrayView2<'a, f64>,
}

/// Returns the first `samples[k]` samples of each record k. Records without such samples are left out.
pub fn heads<'a>(records: &'a [Record], samples: &[usize]) -> Vec<Segment<'a>> {
    records
        .iter()
        .zip(samples)
        .filter(|(_, n)| **n > 0)
        .map(|(record, n)| Segment {
            inputs: record.inputs.slice(s![..*n, ..]),
            outputs: record.outputs.slice(s![..*n, ..]),
        })
        .collect()
}
