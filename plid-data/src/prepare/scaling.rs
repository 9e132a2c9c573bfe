//! Scaling of channels with different units.
use crate::Record;
use ndarray::{Array2, s};
use plid_model::signal::rms;
use serde::{Deserialize, Serialize};

/// The divisor of every channel.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Scaling {
    /// All divisors are one.
    None,
    /// The divisor is the RMS over the training parts of all records. The initial covariance and the noise bank assume
    /// this scaling.
    #[default]
    Rms,
}

/// Scales the records in place and returns the divisors of inputs and outputs in the data's units.
///
/// The divisor of a channel that is zero throughout is one.
pub fn apply(records: &mut [Record], training: &[usize], scaling: Scaling) -> [Vec<f64>; 2] {
    let sides: [fn(&mut Record) -> &mut Array2<f64>; 2] = [|r| &mut r.inputs, |r| &mut r.outputs];
    sides.map(|side| {
        let mut arrays: Vec<&mut Array2<f64>> = records.iter_mut().map(side).collect();
        let channels = arrays.first().map_or(0, |a| a.ncols());
        (0..channels)
            .map(|i| {
                let heads = arrays.iter().zip(training);
                let size = match scaling {
                    Scaling::None => 1.0,
                    Scaling::Rms => rms(heads.flat_map(|(array, n)| array.slice(s![..*n, i]))),
                };
                let size = if size > 0.0 { size } else { 1.0 };
                for array in &mut arrays {
                    array.column_mut(i).mapv_inplace(|v| v / size);
                }
                size
            })
            .collect()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    #[test]
    fn training_parts_get_unit_rms_and_zeros_stay() {
        let before = Record {
            sample_rate_hz: 1.0,
            input_names: vec!["u".into(), "v".into()],
            output_names: vec!["y".into()],
            inputs: array![[3.0, 0.0], [-3.0, 0.0], [6.0, 5.0]],
            outputs: array![[0.1], [f64::NAN], [0.2]],
        };
        let mut records = vec![before.clone()];
        let [inputs, outputs] = apply(&mut records, &[2], Scaling::Rms);
        assert_eq!(inputs, [3.0, 1.0]);
        assert_eq!(outputs, [0.1]);
        assert_eq!(records[0].inputs, array![[1.0, 0.0], [-1.0, 0.0], [2.0, 5.0]]);
        assert!(records[0].outputs[[1, 0]].is_nan());
        assert_eq!(records[0].outputs[[2, 0]], 2.0);

        let mut records = vec![before];
        assert_eq!(apply(&mut records, &[2], Scaling::None), [vec![1.0, 1.0], vec![1.0]]);
    }
}
