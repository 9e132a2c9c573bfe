//! A prefilter that whitens the simulation error when the noise is coloured.
//!
//! Noise that passes through the structure, such as actuator noise, is strongest at the resonances, which determine the
//! model. Treating it as white costs accuracy. Inputs and outputs are therefore filtered by the same moving average
//! A(q), the autoregressive model of the simulation errors of all outputs, and the outputs are then multiplied by a
//! matrix W that makes their errors uncorrelated at each sample. A plant y = H u becomes W A y = (W H) A u: its poles
//! and inputs are unchanged, and C and D are multiplied by W. (Prefiltering by the inverse noise model: Ljung, section
//! 7.3; as a sequence of fits: Clarke's generalised least squares.)

use nalgebra::{Cholesky, DMatrix, DVector};
use ndarray::{Array2, ArrayView2};

use crate::error::RefineError;
use crate::record::{Data, Record, Start};
use crate::sections::Sections;

/// Order of the autoregressive model, if the records are long enough.
const LENGTH: usize = 80;
/// Smallest number of samples per coefficient.
const SAMPLES_EACH: usize = 25;

pub(crate) struct Whitening {
    /// The coefficients 1, a_1, ..., a_L.
    filter: Vec<f64>,
    /// The matrix W (p x p).
    mix: DMatrix<f64>,
}

/// A record of filtered signals.
pub(crate) struct Filtered {
    inputs: Array2<f64>,
    outputs: Array2<f64>,
}

impl Filtered {
    /// Returns the record with an unknown initial state, because the filter discards its first samples.
    pub fn record(&self) -> Record<'_> {
        Record { inputs: self.inputs.view(), outputs: self.outputs.view(), start: Start::Unknown }
    }
}

impl Whitening {
    /// Estimates the prefilter from the simulation errors of each record (samples x p; NaN where missing).
    ///
    /// # Errors
    /// Returns an error if the errors vanish or the records are too short.
    pub fn of(errors: &[Array2<f64>]) -> Result<Self, RefineError> {
        let p = errors.first().map_or(0, Array2::ncols);
        let samples: usize = errors.iter().map(Array2::nrows).sum();
        let length = LENGTH.min(samples / SAMPLES_EACH);
        let failed = RefineError::Decomposition { what: "the noise model" };
        // Each output is divided by its RMS, so that all have equal weight.
        let mut normal = DMatrix::<f64>::zeros(length + 1, length + 1);
        for i in 0..p {
            let mut own = DMatrix::<f64>::zeros(length + 1, length + 1);
            for error in errors {
                let column: Vec<f64> = error.column(i).to_vec();
                for window in column.windows(length + 1).filter(|w| w.iter().all(|x| x.is_finite())) {
                    for a in 0..=length {
                        for b in 0..=a {
                            own[(a, b)] += window[length - a] * window[length - b];
                        }
                    }
                }
            }
            if own[(0, 0)] > 0.0 {
                let power = own[(0, 0)];
                normal += own / power;
            }
        }
        normal.fill_upper_triangle_with_lower_triangle();
        let past = normal.view((1, 1), (length, length)).into_owned();
        let right: DVector<f64> = -normal.view((1, 0), (length, 1)).column(0);
        let found = Cholesky::new(past).ok_or(failed)?.solve(&right);
        let filter: Vec<f64> = std::iter::once(1.0).chain(found.iter().copied()).collect();
        let filtered: Vec<Array2<f64>> = errors.iter().map(|e| convolved(e.view(), &filter)).collect();
        Ok(Self { mix: mixing(&filtered, p)?, filter })
    }

    /// Converts a model of scaled channels to the model W H of the filtered records.
    pub fn mixed(&self, model: &Sections, filtered: &Data) -> Sections {
        let mut to = self.through(model, &(scaling(&filtered.output_scale, -1) * &self.mix));
        to.scale_inputs(&filtered.input_scale, 1);
        to
    }

    /// Converts a model of the filtered records back to one of scaled channels.
    pub fn unmixed(&self, model: &Sections, filtered: &Data) -> Sections {
        let mut to = self.through(model, &(self.unmix() * scaling(&filtered.output_scale, 1)));
        to.scale_inputs(&filtered.input_scale, -1);
        to
    }

    /// Returns the inverse of W.
    pub fn unmix(&self) -> DMatrix<f64> {
        let identity = DMatrix::identity(self.mix.nrows(), self.mix.nrows());
        // W is the inverse of a Cholesky factor, so its diagonal is positive.
        self.mix.solve_lower_triangular(&identity).unwrap_or(identity)
    }

    fn through(&self, model: &Sections, outputs: &DMatrix<f64>) -> Sections {
        Sections { c: outputs * &model.c, d: outputs * &model.d, ..model.clone() }
    }

    pub fn apply(&self, record: &Record<'_>) -> Filtered {
        let outputs = convolved(record.outputs, &self.filter);
        let p = outputs.ncols();
        let mixed = Array2::from_shape_fn(outputs.dim(), |(k, i)| {
            // A zero of W must not propagate a missing output to another output.
            (0..p).filter(|&l| self.mix[(i, l)] != 0.0).map(|l| self.mix[(i, l)] * outputs[(k, l)]).sum()
        });
        Filtered { inputs: convolved(record.inputs, &self.filter), outputs: mixed }
    }
}

fn scaling(scales: &[f64], power: i32) -> DMatrix<f64> {
    DMatrix::from_diagonal(&DVector::from_iterator(scales.len(), scales.iter().map(|s| s.powi(power))))
}

/// Returns the moving average of each channel, from the first sample for which all past samples exist.
fn convolved(signal: ArrayView2<'_, f64>, filter: &[f64]) -> Array2<f64> {
    let length = filter.len() - 1;
    let samples = signal.nrows().saturating_sub(length);
    Array2::from_shape_fn((samples, signal.ncols()), |(k, j)| {
        filter.iter().enumerate().map(|(lag, a)| a * signal[(k + length - lag, j)]).sum()
    })
}

/// Returns a lower triangular W with W cov W' = I. It is diagonal if an output is missing at some sample, because
/// mixing would invalidate the others at that sample.
fn mixing(errors: &[Array2<f64>], p: usize) -> Result<DMatrix<f64>, RefineError> {
    let mut covariance = DMatrix::<f64>::zeros(p, p);
    let gaps = errors.iter().flatten().any(|x| x.is_nan());
    for error in errors {
        for row in error.rows() {
            for a in 0..p {
                for b in 0..p {
                    let product = row[a] * row[b];
                    if product.is_finite() && (a == b || !gaps) {
                        covariance[(a, b)] += product;
                    }
                }
            }
        }
    }
    let samples: usize = errors.iter().map(Array2::nrows).sum();
    covariance /= samples.max(1) as f64;
    let failed = RefineError::Decomposition { what: "the noise model" };
    let root = Cholesky::new(covariance).ok_or(failed)?.unpack();
    root.try_inverse().ok_or(RefineError::Decomposition { what: "the noise model" })
}
