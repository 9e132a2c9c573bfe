//! Identification from arrays. [`identify`] performs all steps; the other functions perform them separately: the
//! recursion, and the selection of the noise covariances, the order and the model.
//!
//! The steps expect channels of comparable size (usually scaled to unit RMS), with one row per sample.

mod calibration;
mod front;
mod noise;
mod order;
mod recursion;
mod to_model;

pub use calibration::innovation_ratio;
pub use front::{Identification, IdentificationError, Identified, Watch, identify};
pub use noise::{Bank, Memory, Point, Search, Split, Trial, Tuned, tune, tune_by};
pub use order::{OrderScan, ScanRow, scan_orders, search_indices};
pub use recursion::{Course, Ending, Paused, Plan, RecursionRun, Watcher, run, run_or_factor};
pub use to_model::ToModel;

use ndarray::ArrayView2;
use plid_core::{IdentifiedModel, IdentifierError, ObservableForm};

use plid_catalogue::VariantError;

/// A record used for identification.
#[derive(Clone, Copy, Debug)]
pub struct Samples<'a> {
    /// Inputs (K x m).
    pub inputs: ArrayView2<'a, f64>,
    /// Outputs (K x p); NaN where a sample is missing.
    pub outputs: ArrayView2<'a, f64>,
    /// Whether a NaN among the outputs marks a missing sample; otherwise a NaN is an error.
    pub nan_is_missing: bool,
}

impl<'a> Samples<'a> {
    /// Returns the number of samples K.
    pub fn len(&self) -> usize {
        self.inputs.nrows()
    }

    /// Returns whether there are no samples.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns samples `from..to`.
    pub fn range(&self, from: usize, to: usize) -> Samples<'a> {
        Samples {
            inputs: self.inputs.slice_move(ndarray::s![from..to, ..]),
            outputs: self.outputs.slice_move(ndarray::s![from..to, ..]),
            nan_is_missing: self.nan_is_missing,
        }
    }
}

/// The reasons why an identification fails.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum IdentifyError {
    /// The recursion could not be constructed, or it failed.
    #[error(transparent)]
    Variant(#[from] VariantError),
    /// No setting of the noise covariances gave a usable model.
    #[error("none of the {trials} noise settings gave a model that remains bounded on the scoring data")]
    NoSetting {
        /// The number of settings tried.
        trials: usize,
    },
    /// The user requested an interruption.
    #[error("interrupted")]
    Interrupted,
}

impl IdentifyError {
    /// Returns the error of the covariance form if P has lost positive definiteness.
    pub fn lost(&self) -> Option<&IdentifierError> {
        match self {
            Self::Variant(VariantError::Identifier(lost @ IdentifierError::Indefinite { .. })) => Some(lost),
            _ => None,
        }
    }
}

/// Simulates an identified model on `samples` from its own state and returns the relative error: the square root of
/// the mean, over the outputs, of the squared error divided by the output's power. The error is infinite if the
/// simulation diverges.
pub fn free_run_error(model: &IdentifiedModel, form: &ObservableForm, samples: Samples<'_>) -> f64 {
    use plid_core::ImplicitModel;
    let (n, p) = (form.states(), form.outputs());
    let mut x = model.state.clone();
    let mut feedback = vec![0.0; p];
    let (mut error, mut power, mut count) = (vec![0.0; p], vec![0.0; p], vec![0usize; p]);
    for (z, u) in samples.outputs.rows().into_iter().zip(samples.inputs.rows()) {
        for (i, &row) in form.output_states().iter().enumerate() {
            feedback[i] = x[row];
            if z[i].is_finite() {
                error[i] += (z[i] - x[row]).powi(2);
                power[i] += z[i] * z[i];
                count[i] += 1;
            }
        }
        // A x is computed from the structure of A: the shift and p columns.
        form.shift(&mut x);
        for (i, &row) in form.output_states().iter().enumerate() {
            // The column of A at c_i holds a_i; the shift has already applied the part of J in this column.
            for r in 0..n {
                let structural = if form.shift_source(r) == Some(row) { 1.0 } else { 0.0 };
                x[r] += (model.a.at(r, row) - structural) * feedback[i];
            }
        }
        for (j, &u) in u.iter().enumerate() {
            plid_core::kernels::axpy(u, model.b.column(j), &mut x);
        }
        if !x.iter().all(|x| x.abs() < 1e6) {
            return f64::INFINITY;
        }
    }
    let relative = (0..p).filter(|&i| count[i] > 0 && power[i] > 0.0).map(|i| error[i] / power[i]);
    let (sum, outputs) = relative.fold((0.0, 0), |(sum, count), x| (sum + x, count + 1));
    if outputs == 0 { f64::INFINITY } else { (sum / outputs as f64).sqrt() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DVector;
    use ndarray::Array2;
    use plid_core::Dense;
    use plid_model::simulate;

    /// Compares the structured simulation with the dense one, with unequal indices and a missing sample.
    #[test]
    fn the_free_run_error_is_that_of_the_plain_simulation() {
        let form = ObservableForm::new(&[2, 1], 2).unwrap();
        let s: Vec<f64> = [0.3, -0.2, 0.5].into_iter().chain((0..12).map(|k| 0.4 * f64::from(k).sin())).collect();
        let model = IdentifiedModel::from_estimate(&form, &s, &Dense::from_diagonal(&[1.0; 15]));
        let inputs = Array2::from_shape_fn((50, 2), |(k, j)| ((7 * k + 3 * j) as f64).cos());
        let mut outputs = Array2::from_shape_fn((50, 2), |(k, i)| ((5 * k + i) as f64).sin());
        outputs[[9, 1]] = f64::NAN;
        let samples = Samples { inputs: inputs.view(), outputs: outputs.view(), nan_is_missing: true };

        let plain = model.to_model(1.0).unwrap();
        let simulated = simulate(&plain, inputs.view(), &DVector::from_vec(model.state.clone())).unwrap().outputs;
        let relative = |i: usize| {
            let there = (0..50).filter(|&k| outputs[[k, i]].is_finite());
            let (error, power) = there.fold((0.0, 0.0), |(e, p), k| {
                (e + (outputs[[k, i]] - simulated[[k, i]]).powi(2), p + outputs[[k, i]].powi(2))
            });
            error / power
        };
        let expected = ((relative(0) + relative(1)) / 2.0).sqrt();
        assert!((free_run_error(&model, &form, samples) - expected).abs() < 1e-12 * expected);
    }
}
