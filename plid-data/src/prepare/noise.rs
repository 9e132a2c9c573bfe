//! The covariance of the output noise, estimated from records that contain only noise.
use super::PrepareError;
use crate::Record;
use ndarray::Array2;
use plid_model::signal::{mean, rms};

/// An estimated covariance of the outputs' noise.
#[derive(Debug, Clone, PartialEq)]
pub struct NoiseCovariance {
    /// Covariance (p x p) in the data's units squared.
    pub covariance: Array2<f64>,
    /// Number of degrees of freedom of the estimate.
    pub freedom: usize,
}

impl NoiseCovariance {
    /// Computes the covariance from a sum of outer products.
    ///
    /// # Errors
    /// Returns an error unless there are more degrees of freedom than outputs, because the covariance would otherwise
    /// be singular.
    pub(super) fn new(sum: Array2<f64>, freedom: usize) -> Result<Self, PrepareError> {
        let outputs = sum.nrows();
        if freedom <= outputs {
            return Err(PrepareError::TooFewForNoise { samples: freedom, outputs });
        }
        Ok(Self { covariance: sum / freedom as f64, freedom })
    }

    /// Returns the RMS of the noise of each output, which is the noise floor of a single measurement.
    pub fn rms(&self) -> Vec<f64> {
        self.covariance.diag().mapv(f64::sqrt).to_vec()
    }
}

/// Estimates the covariance of the outputs about their means from a record without input.
///
/// The covariance contains everything that moves the outputs at rest: sensor noise and ambient disturbances. Because a
/// measured zero is noisy, the inputs may have an RMS of `input_limit` about their means, in their units.
///
/// # Errors
/// Returns an error if an input is not zero, or if there are too few complete samples.
pub fn noise_from_zero_input(record: &Record, input_limit: f64) -> Result<NoiseCovariance, PrepareError> {
    for (channel, column) in record.input_names.iter().zip(record.inputs.columns()) {
        let about = &column - mean(column);
        let size = rms(about.view());
        // The mean of equal numbers may differ from them by rounding.
        let rounding = 1e-12 * rms(column);
        if size.is_nan() || size > input_limit + rounding {
            return Err(PrepareError::InputNotZero { channel: channel.clone(), rms: size, limit: input_limit });
        }
    }
    let p = record.outputs.ncols();
    let complete: Vec<_> = record.outputs.rows().into_iter().filter(|row| row.iter().all(|v| !v.is_nan())).collect();
    let means: Vec<f64> =
        (0..p).map(|i| complete.iter().map(|row| row[i]).sum::<f64>() / complete.len() as f64).collect();
    let sum = Array2::from_shape_fn((p, p), |(i, j)| {
        complete.iter().map(|row| (row[i] - means[i]) * (row[j] - means[j])).sum()
    });
    NoiseCovariance::new(sum, complete.len().saturating_sub(1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::test_plants::Gaussian;

    fn at_rest(samples: usize) -> Record {
        let mut g = Gaussian::new(3);
        let mut outputs = Array2::zeros((samples, 2));
        for mut row in outputs.rows_mut() {
            let (a, b) = (g.draw(), g.draw());
            row[0] = 5.0 + 0.3 * a;
            row[1] = -0.1 * a + 0.2 * b;
        }
        Record {
            sample_rate_hz: 1.0,
            input_names: vec!["u".into()],
            output_names: vec!["y".into(), "z".into()],
            inputs: Array2::from_elem((samples, 1), 0.7),
            outputs,
        }
    }

    #[test]
    fn a_record_at_rest_gives_the_covariance_about_the_mean() {
        let mut record = at_rest(20_000);
        record.outputs[[5, 0]] = f64::NAN;
        let noise = noise_from_zero_input(&record, 0.0).unwrap();
        let c = &noise.covariance;
        for (at, truth) in [([0, 0], 0.09), ([1, 1], 0.05), ([0, 1], -0.03)] {
            assert!((c[at] - truth).abs() < 0.003, "{at:?} {}", c[at]);
        }
        assert!((noise.rms()[0] - 0.3).abs() < 0.005);
        assert_eq!(noise.freedom, 19_998);
    }

    #[test]
    fn an_input_or_a_short_record_is_refused() {
        let mut record = at_rest(100);
        record.inputs[[50, 0]] += 1.0;
        // One sample of 1 in 100 has an RMS of 0.0995 about the mean.
        let error = noise_from_zero_input(&record, 0.05).unwrap_err();
        assert!(matches!(error, PrepareError::InputNotZero { .. }));
        assert!(noise_from_zero_input(&record, 0.1).is_ok());
        let error = noise_from_zero_input(&at_rest(3), 0.0).unwrap_err();
        assert!(matches!(error, PrepareError::TooFewForNoise { .. }));
    }
}
