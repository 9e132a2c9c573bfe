use ndarray::ArrayView2;

use super::error::{SignalError, check_record, check_rows};
use super::statistics::{mean, rms};

/// Error measures of a prediction or simulation against the measured outputs. Each vector has one element per output.
#[derive(Debug, Clone, PartialEq)]
pub struct ErrorMeasures {
    /// RMS(y - yhat), in the output's unit.
    pub rms_error: Vec<f64>,
    /// RMS(y - yhat) / RMS(y); NaN if the output is zero throughout.
    pub relative: Vec<f64>,
    /// 100 (1 - |y - yhat| / |y - mean y|), the fit of MATLAB's `compare`; NaN if the output is constant.
    pub fit_percent: Vec<f64>,
    /// Number of samples of each output, without the missing ones.
    pub samples: Vec<usize>,
    /// Relative error over all outputs together, each scaled to unit RMS; outputs that are zero throughout are
    /// excluded.
    pub overall_relative: f64,
}

impl ErrorMeasures {
    /// Returns the measures of outputs that were divided by these scales, in the units that they had before.
    #[must_use]
    pub fn in_units(mut self, scales: &[f64]) -> Self {
        self.rms_error.iter_mut().zip(scales).for_each(|(error, scale)| *error *= scale);
        self
    }
}

/// Computes the error measures of `predicted` against `measured` (both `samples x p`).
///
/// A NaN in `measured` is a missing sample and is excluded. A prediction that is not finite where the output is present
/// makes the error of that output infinite.
///
/// # Errors
/// Returns [`SignalError::LengthMismatch`], [`SignalError::ChannelMismatch`], [`SignalError::NoChannels`],
/// [`SignalError::Infinite`] for the measured outputs, or [`SignalError::TooShort`] for an output without samples.
pub fn error_measures(measured: ArrayView2<f64>, predicted: ArrayView2<f64>) -> Result<ErrorMeasures, SignalError> {
    check_record("the measured output", measured)?;
    check_rows("the predicted output", predicted, measured.nrows())?;
    if predicted.ncols() != measured.ncols() {
        return Err(SignalError::ChannelMismatch {
            what: "the predicted output",
            expected: measured.ncols(),
            found: predicted.ncols(),
        });
    }
    let mut result = ErrorMeasures {
        rms_error: Vec::new(),
        relative: Vec::new(),
        fit_percent: Vec::new(),
        samples: Vec::new(),
        overall_relative: f64::NAN,
    };
    let (mut scaled_error, mut scaled_samples) = (0.0, 0.0);
    for (y, prediction) in measured.columns().into_iter().zip(predicted.columns()) {
        let present: Vec<(f64, f64)> =
            y.iter().copied().zip(prediction.iter().copied()).filter(|(y, _)| !y.is_nan()).collect();
        if present.is_empty() {
            return Err(SignalError::TooShort { what: "an error measure", unit: "samples", needed: 1, available: 0 });
        }
        let n = present.len() as f64;
        let mean = mean(present.iter().map(|(y, _)| y));
        let finite = |e: f64| if e.is_finite() { e } else { f64::INFINITY };
        let error = (present.iter().map(|(y, p)| finite(y - p).powi(2)).sum::<f64>() / n).sqrt();
        let size = rms(present.iter().map(|(y, _)| *y));
        let spread = rms(present.iter().map(|(y, _)| y - mean));
        result.rms_error.push(error);
        result.relative.push(if size > 0.0 { error / size } else { f64::NAN });
        result.fit_percent.push(if spread > 0.0 { 100.0 * (1.0 - error / spread) } else { f64::NAN });
        result.samples.push(present.len());
        if size > 0.0 {
            scaled_error += n * (error / size).powi(2);
            scaled_samples += n;
        }
    }
    result.overall_relative = (scaled_error / scaled_samples).sqrt();
    Ok(result)
}

/// The sums behind [`error_measures`], for records that are not held in memory.
#[derive(Debug, Clone)]
pub struct ErrorSums(Vec<OutputSums>);

/// The sums of one output.
#[derive(Debug, Clone, Default)]
struct OutputSums {
    samples: usize,
    errors: f64,
    squares: f64,
    /// The first sample, which is subtracted from the samples in the next two sums to avoid cancellation.
    first: f64,
    from_first: f64,
    from_first_squares: f64,
}

impl ErrorSums {
    /// Starts with no samples of `outputs` outputs.
    pub fn new(outputs: usize) -> Self {
        Self(vec![OutputSums::default(); outputs])
    }

    /// Adds samples of `predicted` against `measured` (both `samples x p`), as in [`error_measures`].
    ///
    /// # Errors
    /// Returns [`SignalError::LengthMismatch`] or [`SignalError::ChannelMismatch`].
    pub fn add(&mut self, measured: ArrayView2<f64>, predicted: ArrayView2<f64>) -> Result<(), SignalError> {
        check_rows("the predicted output", predicted, measured.nrows())?;
        for (what, found) in [("the measured output", measured.ncols()), ("the predicted output", predicted.ncols())] {
            if found != self.0.len() {
                return Err(SignalError::ChannelMismatch { what, expected: self.0.len(), found });
            }
        }
        for (sums, (y, prediction)) in self.0.iter_mut().zip(measured.columns().into_iter().zip(predicted.columns())) {
            for (&y, &prediction) in y.iter().zip(prediction).filter(|(y, _)| !y.is_nan()) {
                if sums.samples == 0 {
                    sums.first = y;
                }
                let error = y - prediction;
                sums.samples += 1;
                sums.errors += if error.is_finite() { error * error } else { f64::INFINITY };
                sums.squares += y * y;
                sums.from_first += y - sums.first;
                sums.from_first_squares += (y - sums.first).powi(2);
            }
        }
        Ok(())
    }

    /// Returns the measures of all samples so far.
    ///
    /// # Errors
    /// Returns [`SignalError::TooShort`] for an output without samples.
    pub fn measures(&self) -> Result<ErrorMeasures, SignalError> {
        if self.0.iter().any(|sums| sums.samples == 0) {
            return Err(SignalError::TooShort { what: "an error measure", unit: "samples", needed: 1, available: 0 });
        }
        let n = |sums: &OutputSums| sums.samples as f64;
        let error = |sums: &OutputSums| (sums.errors / n(sums)).sqrt();
        let size = |sums: &OutputSums| (sums.squares / n(sums)).sqrt();
        let spread = |sums: &OutputSums| {
            (sums.from_first_squares / n(sums) - (sums.from_first / n(sums)).powi(2)).max(0.0).sqrt()
        };
        let over = |a: f64, b: f64| if b > 0.0 { a / b } else { f64::NAN };
        let each = |of: &dyn Fn(&OutputSums) -> f64| self.0.iter().map(of).collect::<Vec<f64>>();
        let sized = || self.0.iter().filter(|sums| size(sums) > 0.0);
        let scaled_error: f64 = sized().map(|sums| n(sums) * (error(sums) / size(sums)).powi(2)).sum();
        Ok(ErrorMeasures {
            rms_error: each(&error),
            relative: each(&|sums| over(error(sums), size(sums))),
            fit_percent: each(&|sums| 100.0 * (1.0 - over(error(sums), spread(sums)))),
            samples: self.0.iter().map(|sums| sums.samples).collect(),
            overall_relative: (scaled_error / sized().map(n).sum::<f64>()).sqrt(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::{Array2, array};

    /// Two blocks give the measures of the whole, with a large mean, a missing sample and an output that is zero.
    #[test]
    fn sums_over_blocks_are_the_measures_of_the_whole() {
        let mut y = Array2::from_shape_fn((40, 3), |(k, i)| [1e4, 1.0, 0.0][i] * (1.0 + (k as f64).sin()));
        let predicted = y.mapv(|y| 0.9 * y + 0.1);
        y[[7, 0]] = f64::NAN;
        let whole = error_measures(y.view(), predicted.view()).unwrap();
        let mut sums = ErrorSums::new(3);
        for rows in [0..11, 11..40] {
            let rows = ndarray::s![rows, ..];
            sums.add(y.slice(rows), predicted.slice(rows)).unwrap();
        }
        let found = sums.measures().unwrap();
        let close = |a: &f64, b: &f64| (a - b).abs() <= 1e-12 * b.abs() || a.is_nan() && b.is_nan();
        let all = |m: &ErrorMeasures| [&m.rms_error[..], &m.relative, &m.fit_percent, &[m.overall_relative]].concat();
        assert!(all(&found).iter().zip(&all(&whole)).all(|(a, b)| close(a, b)), "{found:?} {whole:?}");
        assert_eq!(found.samples, [39, 40, 40]);
        sums.add(y.view(), predicted.mapv(|_| f64::NAN).view()).unwrap();
        assert!(sums.measures().unwrap().overall_relative.is_infinite());
        assert!(ErrorSums::new(1).measures().is_err());
    }

    #[test]
    fn figures_worked_by_hand() {
        let y = array![[3.0, 10.0], [4.0, -10.0], [f64::NAN, 10.0], [5.0, -10.0]];
        let p = array![[3.0, 11.0], [5.0, -9.0], [99.0, 9.0], [5.0, -11.0]];
        let m = error_measures(y.view(), p.view()).unwrap();
        assert_eq!(m.samples, [3, 4]);
        assert!((m.rms_error[0] - (1.0f64 / 3.0).sqrt()).abs() < 1e-15);
        assert!((m.relative[0] - (1.0f64 / 50.0).sqrt()).abs() < 1e-15);
        // |y - mean| = sqrt(2), |e| = 1.
        assert!((m.fit_percent[0] - 100.0 * (1.0 - 0.5f64.sqrt())).abs() < 1e-12);
        assert!((m.relative[1] - 0.1).abs() < 1e-15 && (m.fit_percent[1] - 90.0).abs() < 1e-12);
        // (3 / 50 + 4 / 100) / 7.
        assert!((m.overall_relative - (0.1f64 / 7.0).sqrt()).abs() < 1e-15);
    }

    #[test]
    fn a_diverged_prediction_is_not_a_gap_and_a_silent_output_has_no_relative_error() {
        let y = array![[1.0, 0.0], [2.0, 0.0]];
        let p = array![[1.0, 0.5], [f64::NAN, 0.5]];
        let m = error_measures(y.view(), p.view()).unwrap();
        assert_eq!(m.rms_error[0], f64::INFINITY);
        assert_eq!(m.overall_relative, f64::INFINITY);
        assert!(m.relative[1].is_nan() && m.fit_percent[1].is_nan() && m.rms_error[1] == 0.5);
    }

    #[test]
    fn bad_shapes_are_refused() {
        let y = array![[1.0], [f64::NAN]];
        assert!(matches!(error_measures(y.view(), array![[1.0]].view()), Err(SignalError::LengthMismatch { .. })));
        assert!(matches!(
            error_measures(y.view(), Array2::zeros((2, 2)).view()),
            Err(SignalError::ChannelMismatch { .. })
        ));
        let gone = array![[f64::NAN]];
        assert!(matches!(error_measures(gone.view(), gone.view()), Err(SignalError::TooShort { .. })));
    }
}
