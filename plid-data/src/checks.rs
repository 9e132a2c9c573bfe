//! Checks for data that can be read but contain no information.
use super::{DataError, Record, Warning};
use ndarray::ArrayView1;
use std::path::Path;

/// Checks that the inputs and outputs of a record change at all. `file` names the record in errors.
///
/// # Errors
/// Returns [`DataError::NoExcitation`] or [`DataError::NoResponse`] if all inputs or all outputs are constant. A single
/// constant channel is a warning.
pub fn check_excited(file: &Path, record: &Record) -> Result<Vec<Warning>, DataError> {
    let constant = |array: &ndarray::Array2<f64>, names: &[String]| -> Vec<String> {
        names.iter().enumerate().filter(|(i, _)| is_constant(array.column(*i))).map(|(_, name)| name.clone()).collect()
    };
    let inputs = constant(&record.inputs, &record.input_names);
    let outputs = constant(&record.outputs, &record.output_names);
    judge_constant(file, [inputs, outputs], [record.input_names.len(), record.output_names.len()])
}

/// Judges the inputs and outputs that are constant, given the numbers of all inputs and outputs. The errors are those
/// of [`check_excited`].
pub(super) fn judge_constant(
    file: &Path,
    [inputs, outputs]: [Vec<String>; 2],
    [m, p]: [usize; 2],
) -> Result<Vec<Warning>, DataError> {
    if inputs.len() == m {
        return Err(DataError::NoExcitation { file: file.into(), channels: inputs });
    }
    if outputs.len() == p {
        return Err(DataError::NoResponse { file: file.into(), channels: outputs });
    }
    let inputs = inputs.into_iter().map(|channel| Warning::ConstantInput { channel });
    let outputs = outputs.into_iter().map(|channel| Warning::ConstantOutput { channel });
    Ok(inputs.chain(outputs).collect())
}

/// Returns whether all values that are not missing are equal.
fn is_constant(values: ArrayView1<f64>) -> bool {
    let mut present = values.iter().filter(|v| !v.is_nan());
    match present.next() {
        Some(first) => present.all(|v| v == first),
        None => true,
    }
}

/// Checks the number of samples against the number of unknown parameters of an output.
///
/// Each sample of an output is one equation for the parameters of its row. Fewer than four equations per unknown give a
/// warning, because the estimate then depends on its prior.
///
/// # Errors
/// Returns [`DataError::TooFewSamples`] if there are fewer samples than unknowns.
pub fn require_samples(samples: usize, unknowns: usize) -> Result<Option<Warning>, DataError> {
    if samples < unknowns {
        return Err(DataError::TooFewSamples { samples, unknowns });
    }
    let few = samples < unknowns.saturating_mul(4);
    Ok(few.then_some(Warning::FewSamples { samples, unknowns }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    fn record() -> Record {
        Record {
            sample_rate_hz: 1.0,
            input_names: vec!["u1".into(), "u2".into()],
            output_names: vec!["y1".into(), "y2".into()],
            inputs: array![[1.0, 5.0], [2.0, 6.0], [3.0, 5.0]],
            outputs: array![[1.0, f64::NAN], [2.0, 7.0], [f64::NAN, 8.0]],
        }
    }

    #[test]
    fn constant_channels_are_named() {
        assert_eq!(check_excited(Path::new("a.csv"), &record()).unwrap(), []);
        let mut r = record();
        r.inputs.column_mut(1).fill(3.0);
        r.outputs[[2, 1]] = 7.0;
        let warnings = check_excited(Path::new("a.csv"), &r).unwrap();
        let said: Vec<String> = warnings.iter().map(Warning::to_string).collect();
        assert!(said[0].contains("input `u2` is constant"));
        assert!(said[1].contains("output `y2` is constant"));
        assert_eq!(said.len(), 2);
    }

    #[test]
    fn no_excitation_and_no_response_are_errors() {
        let mut r = record();
        r.inputs.fill(0.0);
        assert!(matches!(check_excited(Path::new("a.csv"), &r), Err(DataError::NoExcitation { .. })));
        let mut r = record();
        r.outputs.fill(1.0);
        assert!(matches!(check_excited(Path::new("a.csv"), &r), Err(DataError::NoResponse { .. })));
    }

    #[test]
    fn samples_are_held_against_unknowns() {
        assert!(matches!(require_samples(9, 10), Err(DataError::TooFewSamples { .. })));
        let warning = require_samples(39, 10).unwrap();
        assert_eq!(warning, Some(Warning::FewSamples { samples: 39, unknowns: 10 }));
        assert_eq!(require_samples(40, 10).unwrap(), None);
    }
}
