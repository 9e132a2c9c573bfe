//! Means and straight-line trends.
use crate::Record;
use ndarray::{Array2, ArrayView1, s};
use plid_model::signal::mean;
use serde::{Deserialize, Serialize};

/// The trend that is removed from every channel.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Trend {
    /// No trend is removed.
    None,
    /// The mean over the training parts of all records together.
    #[default]
    Mean,
    /// A straight line for each record, fitted to its training part and extrapolated over the rest. From a record
    /// without a training part, only the pooled mean is removed.
    Linear,
}

/// `offset + slope * t`, with t in s since the record's first sample.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Line {
    /// Offset in the channel's units.
    pub offset: f64,
    /// Slope in the channel's units per second.
    pub slope_per_s: f64,
}

/// Removes the trend in place and returns the lines of the inputs and outputs of each record.
pub fn remove(records: &mut [Record], training: &[usize], trend: Trend) -> Vec<[Vec<Line>; 2]> {
    if trend == Trend::None {
        return records
            .iter()
            .map(|r| [r.inputs.ncols(), r.outputs.ncols()].map(|n| vec![Line::default(); n]))
            .collect();
    }
    let rates: Vec<f64> = records.iter().map(|r| r.sample_rate_hz).collect();
    let inputs = lines(records, |r| &mut r.inputs, training, &rates, trend);
    let outputs = lines(records, |r| &mut r.outputs, training, &rates, trend);
    inputs.into_iter().zip(outputs).map(|(u, y)| [u, y]).collect()
}

fn lines(
    records: &mut [Record],
    side: fn(&mut Record) -> &mut Array2<f64>,
    training: &[usize],
    rates: &[f64],
    trend: Trend,
) -> Vec<Vec<Line>> {
    let mut arrays: Vec<&mut Array2<f64>> = records.iter_mut().map(side).collect();
    let channels = arrays.first().map_or(0, |a| a.ncols());
    let mut all = vec![Vec::new(); arrays.len()];
    for i in 0..channels {
        let heads = arrays.iter().zip(training);
        let pooled = mean(heads.flat_map(|(array, n)| array.slice(s![..*n, i])));
        for (r, array) in arrays.iter_mut().enumerate() {
            let line = match trend {
                Trend::Linear if training[r] > 1 => fit(array.slice(s![..training[r], i]), rates[r]),
                _ => Line { offset: pooled, slope_per_s: 0.0 },
            };
            for (k, value) in array.column_mut(i).iter_mut().enumerate() {
                *value -= line.offset + line.slope_per_s * k as f64 / rates[r];
            }
            all[r].push(line);
        }
    }
    all
}

/// Fits a line by least squares to the values that are not missing.
fn fit(values: ArrayView1<f64>, rate_hz: f64) -> Line {
    let present: Vec<(f64, f64)> =
        values.iter().enumerate().filter(|(_, v)| !v.is_nan()).map(|(k, v)| (k as f64 / rate_hz, *v)).collect();
    let count = (present.len() as f64).max(1.0);
    let t_mean = present.iter().map(|(t, _)| t).sum::<f64>() / count;
    let v_mean = present.iter().map(|(_, v)| v).sum::<f64>() / count;
    let across: f64 = present.iter().map(|(t, v)| (t - t_mean) * (v - v_mean)).sum();
    let along: f64 = present.iter().map(|(t, _)| (t - t_mean).powi(2)).sum();
    let slope = if along > 0.0 { across / along } else { 0.0 };
    Line { offset: v_mean - slope * t_mean, slope_per_s: slope }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    fn record(inputs: Array2<f64>, outputs: Array2<f64>) -> Record {
        Record { sample_rate_hz: 2.0, input_names: vec!["u".into()], output_names: vec!["y".into()], inputs, outputs }
    }

    #[test]
    fn means_are_those_of_the_training_parts_together() {
        let mut records = vec![
            record(array![[1.0], [3.0], [99.0]], array![[1.0], [f64::NAN], [7.0]]),
            record(array![[8.0], [5.0]], array![[3.0], [5.0]]),
        ];
        let lines = remove(&mut records, &[2, 1], Trend::Mean);
        // The means are (1 + 3 + 8) / 3 and, without the missing sample, (1 + 3) / 2.
        assert_eq!(lines[1][0][0].offset, 4.0);
        assert_eq!(lines[0][1][0].offset, 2.0);
        assert_eq!(records[0].inputs, array![[-3.0], [-1.0], [95.0]]);
        assert_eq!(records[1].outputs, array![[1.0], [3.0]]);
    }

    #[test]
    fn a_straight_line_is_removed_exactly_and_extrapolated() {
        let ramp = |k: usize| 3.0 - 0.25 * k as f64;
        let y = Array2::from_shape_fn((20, 1), |(k, _)| ramp(k));
        let mut records = vec![record(y.clone(), y)];
        let lines = remove(&mut records, &[10], Trend::Linear);
        assert!((lines[0][1][0].slope_per_s + 0.5).abs() < 1e-12);
        assert!(records[0].outputs.iter().all(|v| v.abs() < 1e-12));
    }

    #[test]
    fn none_changes_nothing() {
        let before = record(array![[1.0], [3.0]], array![[1.0], [2.0]]);
        let mut records = vec![before.clone()];
        assert_eq!(remove(&mut records, &[2], Trend::None)[0][0], [Line::default()]);
        assert_eq!(records[0], before);
    }
}
