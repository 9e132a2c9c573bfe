//! A record: inputs and outputs over time.
use super::DataError;
use ndarray::Array2;

/// Inputs and outputs of one experiment, evenly sampled.
#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    /// Sample rate in Hz, finite and positive.
    pub sample_rate_hz: f64,
    /// Names of the m inputs.
    pub input_names: Vec<String>,
    /// Names of the p outputs.
    pub output_names: Vec<String>,
    /// Inputs (K x m) in the data's units. All values are finite.
    pub inputs: Array2<f64>,
    /// Outputs (K x p) in the data's units. NaN marks a missing sample where the policy allows it.
    pub outputs: Array2<f64>,
}

impl Record {
    /// Returns the number of samples K.
    pub fn samples(&self) -> usize {
        self.inputs.nrows()
    }

    /// Returns the duration in s.
    pub fn duration_s(&self) -> f64 {
        self.samples() as f64 / self.sample_rate_hz
    }
}

/// Checks that records have the same channels and rate, so that one model applies to all of them.
///
/// # Errors
/// Returns [`DataError::RecordsDiffer`] with the record and the difference.
pub fn require_alike(records: &[Record]) -> Result<(), DataError> {
    let Some((first, rest)) = records.split_first() else {
        return Ok(());
    };
    for (i, other) in rest.iter().enumerate() {
        let differs = |what: String| Err(DataError::RecordsDiffer { record: i + 2, what });
        // A rate from a column of printed times is only known to within their rounding.
        let (rate, expected) = (other.sample_rate_hz, first.sample_rate_hz);
        if (rate - expected).abs() > 1e-4 * expected {
            return differs(format!("{rate} Hz where {expected} Hz is expected"));
        }
        if other.input_names != first.input_names {
            return differs(format!("inputs {}", other.input_names.join(", ")));
        }
        if other.output_names != first.output_names {
            return differs(format!("outputs {}", other.output_names.join(", ")));
        }
    }
    Ok(())
}
