//! Conversion of an estimate to a model that can be simulated, analysed and saved.

use nalgebra::DMatrix;
use plid_core::{Dense, IdentifiedModel};
use plid_model::{Model, ModelError};

/// Conversion of an estimate to a [`Model`].
pub trait ToModel {
    /// Returns the state-space model with the covariance of its parameters, if the estimate has one; `rate` is the
    /// sample rate in Hz.
    ///
    /// # Errors
    /// Returns a [`ModelError`] if the rate is not positive or the estimate is not finite.
    fn to_model(&self, rate: f64) -> Result<Model, ModelError>;
}

impl ToModel for IdentifiedModel {
    fn to_model(&self, rate: f64) -> Result<Model, ModelError> {
        let (n, m, p) = (self.a.rows(), self.b.columns(), self.c.rows());
        let (a, b, c) = ((&self.a).into(), (&self.b).into(), (&self.c).into());
        let mut model = Model::new(rate, a, b, c, DMatrix::zeros(p, m))?;
        model.observability_indices = indices(&self.c);
        let size = (p + m) * n;
        if self.covariance.rows() == n + size {
            let covariance = DMatrix::from(&self.covariance).view((n, n), (size, size)).into_owned();
            // The last digits of a covariance carried in single precision may differ between the triangles.
            model.parameter_covariance = Some((&covariance + covariance.transpose()) / 2.0);
        }
        Ok(model)
    }
}

/// Returns the observability indices of the canonical form in which output i reads the last state of block i; `None`
/// if C is not of this form.
fn indices(c: &Dense<f64>) -> Option<Vec<usize>> {
    let mut indices = Vec::with_capacity(c.rows());
    let mut begin = 0;
    for output in 0..c.rows() {
        let last = (begin..c.columns()).find(|&state| c.at(output, state) != 0.0)?;
        let is_unit = (0..c.columns()).all(|state| c.at(output, state) == if state == last { 1.0 } else { 0.0 });
        if !is_unit {
            return None;
        }
        indices.push(last + 1 - begin);
        begin = last + 1;
    }
    (begin == c.columns()).then_some(indices)
}

#[cfg(test)]
mod tests {
    use super::*;
    use plid_core::{ImplicitModel, ObservableForm};

    #[test]
    fn the_model_has_the_matrices_the_indices_and_the_covariance_of_the_parameters() {
        let form = ObservableForm::new(&[1, 3, 2], 2).unwrap();
        let size = form.joint_states();
        let s: Vec<f64> = (0..size).map(|k| (k as f64).sin()).collect();
        let covariance = Dense::from_fn(size, size, |i, j| if i == j { 1.0 + i as f64 } else { 0.01 });
        let identified = IdentifiedModel::from_estimate(&form, &s, &covariance);
        let model = identified.to_model(50.0).unwrap();
        assert_eq!(model.observability_indices.as_deref(), Some(&[1, 3, 2][..]));
        assert_eq!(model.a[(1, 0)], identified.a.at(1, 0));
        assert_eq!(model.b[(4, 1)], identified.b.at(4, 1));
        let covariance = model.parameter_covariance.unwrap();
        assert_eq!(covariance.shape(), (size - 6, size - 6));
        assert_eq!((covariance[(0, 0)], covariance[(3, 5)]), (7.0, 0.01));
        assert!(identified.to_model(0.0).is_err());
        let without = IdentifiedModel { covariance: Dense::from_diagonal(&[]), ..identified };
        assert_eq!(without.to_model(50.0).unwrap().parameter_covariance, None);
    }

    #[test]
    fn another_output_matrix_has_no_indices() {
        for c in [[0.0, 2.0], [1.0, 0.0], [1.0, 1.0], [0.0, 0.0]] {
            assert_eq!(indices(&Dense::from_fn(1, 2, |_, j| c[j])), None);
        }
    }
}
