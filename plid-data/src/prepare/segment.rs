//! The part of a record that an estimate may look at.
use crate::Record;
use ndarray::{ArrayView1, ArrayView2, s};

/// Inputs and outputs of a stretch of samples.
#[derive(Debug, Clone, Copy)]
pub struct Segment<'a> {
    /// K x m.
    pub inputs: ArrayView2<'a, f64>,
    /// K x p, NaN where missing.
    pub outputs: ArrayView2<'a, f64>,
}

/// The first `samples` samples of each record; records without any are left out.
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

/// Mean over the values that are there, of all parts together; 0 if there is none.
pub(super) fn mean<'a>(parts: impl IntoIterator<Item = ArrayView1<'a, f64>>) -> f64 {
    let (mut sum, mut count) = (0.0, 0_usize);
    for part in parts {
        for value in part.iter().filter(|v| !v.is_nan()) {
            sum += value;
            count += 1;
        }
    }
    if count == 0 { 0.0 } else { sum / count as f64 }
}

/// RMS over the values that are there, of all parts together; 0 if there is none.
pub(super) fn rms<'a>(parts: impl IntoIterator<Item = ArrayView1<'a, f64>>) -> f64 {
    let (mut sum, mut count) = (0.0, 0_usize);
    for part in parts {
        for value in part.iter().filter(|v| !v.is_nan()) {
            sum += value * value;
            count += 1;
        }
    }
    if count == 0 { 0.0 } else { (sum / count as f64).sqrt() }
}
