//! The model that belongs to an estimate.

use crate::{Dense, ImplicitModel, Matrix, Scalar};

/// The model x_{k+1} = A x_k + B u_k, y_k = C x_k in the canonical form, with the covariance of its estimate.
#[derive(Clone, Debug, PartialEq)]
pub struct IdentifiedModel {
    /// A, n x n.
    pub a: Dense<f64>,
    /// B, n x m.
    pub b: Dense<f64>,
    /// C, p x n.
    pub c: Dense<f64>,
    /// The prediction of the next state, n entries.
    pub state: Vec<f64>,
    /// The covariance of s = [x; a_1 .. a_p; b_1 .. b_m], N x N.
    pub covariance: Dense<f64>,
}

impl IdentifiedModel {
    /// Forms A = J + sum_i a_i e_{c_i}^T, B = [b_1 .. b_m], and C from the states that the outputs read.
    pub fn from_estimate<S: Scalar>(model: &dyn ImplicitModel, s: &[S], covariance: &Dense<S>) -> Self {
        let (n, m, p) = (model.states(), model.inputs(), model.outputs());
        let mut a = Dense::zeros(n, n);
        for i in 0..n {
            if let Some(j) = model.shift_source(i) {
                *a.at_mut(i, j) = 1.0;
            }
        }
        let mut c = Dense::zeros(p, n);
        for (output, &column) in model.output_states().iter().enumerate() {
            *c.at_mut(output, column) = 1.0;
            for i in 0..n {
                *a.at_mut(i, column) += s[(1 + output) * n + i].to_f64();
            }
        }
        Self {
            a,
            b: Dense::from_fn(n, m, |i, j| s[(1 + p + j) * n + i].to_f64()),
            c,
            state: s[..n].iter().map(|x| x.to_f64()).collect(),
            covariance: covariance.cast(),
        }
    }

    /// Returns the parameters [a_1; ..; a_p; b_1; ..; b_m], (p + m) n entries. This is the inverse of
    /// [`IdentifiedModel::from_estimate`].
    pub fn parameters(&self, model: &dyn ImplicitModel) -> Vec<f64> {
        let mut parameters = Vec::with_capacity(model.parameter_columns() * model.states());
        for &column in model.output_states() {
            parameters.extend((0..model.states()).map(|i| {
                let structural = if model.shift_source(i) == Some(column) { 1.0 } else { 0.0 };
                self.a.at(i, column) - structural
            }));
        }
        parameters.extend_from_slice(self.b.data());
        parameters
    }
}
