//! Moment matching, psi = Z^k throughout: the second moments of the next state are exact if s given Z^k is Gaussian.

use plid_core::kernels::{Kernels, axpy};
use plid_core::{
    ConditionalExpectations, CovarianceBlocks, Dense, Expectation, FormFacts, ImplicitModel, Matrix, StepSize,
    StepView, Term, Transition,
};

use super::{Scratch, condition_on_sensor_noise, noise_flops, regress_on_estimate};

/// Moment matching.
///
/// The row g_t that multiplies parameter column t is e_{c_i}^T for a_i and -(L C)_j for b_j: a combination of the
/// outputs' rows, g_t = sum_i W_ti e_{c_i}^T. With E_ij = sum_t W_tj P_{theta_t, x_{c_i}} the two sums over parameter
/// pairs become the sum over s, t of (W H P H^T W^T)_st P_{theta_s theta_t} and the sum over i, j of E_ij E_ji^T. The
/// drift is the sum of E_ii.
#[derive(Clone, Debug)]
pub struct MomentMatched<S> {
    scratch: Scratch<S>,
    /// P+ H^T, N x p.
    outputs: Dense<S>,
    /// W, (p + m) x p.
    rows: Dense<S>,
    /// W H P H^T, (p + m) x p.
    product: Dense<S>,
    weights: Dense<S>,
    /// E_ij in column i p + j, n x p^2.
    crossed: Dense<S>,
    /// E_ji in the same column.
    swapped: Dense<S>,
}

impl<S: Kernels> ConditionalExpectations for MomentMatched<S> {
    type Scalar = S;
    type Options = ();

    fn new(model: &dyn ImplicitModel, _: &()) -> Self {
        let (n, p, columns) = (model.states(), model.outputs(), model.parameter_columns());
        Self {
            scratch: Scratch::new(model),
            outputs: Dense::zeros(model.joint_states(), p),
            rows: Dense::zeros(columns, p),
            product: Dense::zeros(columns, p),
            weights: Dense::zeros(columns, columns),
            crossed: Dense::zeros(n, p * p),
            swapped: Dense::zeros(n, p * p),
        }
    }

    fn after(
        &mut self,
        step: &StepView<'_, S>,
        covariance: &mut dyn CovarianceBlocks<S>,
        transition: &mut Transition<S>,
    ) {
        condition_on_sensor_noise(step, &mut self.scratch, transition);
        regress_on_estimate(step, transition);
        let StepView { model, noise, .. } = step;
        let (n, p, m) = (model.states(), model.outputs(), model.inputs());
        let one = S::one();
        covariance.output_columns(model.output_states(), self.outputs.view_mut());

        self.rows.fill(S::zero());
        for i in 0..p {
            *self.rows.at_mut(i, i) = one;
        }
        for (k, &i) in noise.available().iter().enumerate() {
            for j in 0..m {
                *self.rows.at_mut(p + j, i) = -noise.l().at(j, k);
            }
        }

        self.product.fill(S::zero());
        for j in 0..p {
            for (i, &row) in model.output_states().iter().enumerate() {
                axpy(self.outputs.at(row, j), self.rows.column(i), self.product.column_mut(j));
            }
        }
        self.weights.fill(S::zero());
        for t in 0..p + m {
            for i in 0..p {
                axpy(self.rows.at(t, i), self.product.column(i), self.weights.column_mut(t));
            }
        }
        for j in 0..m {
            for l in 0..m {
                *self.weights.at_mut(p + j, p + l) += noise.actuator_given().at(j, l);
            }
        }
        covariance.add_parameter_blocks(&self.weights, transition.qbar.view_mut());

        self.crossed.fill(S::zero());
        for i in 0..p {
            let theta = &self.outputs.column(i)[n..];
            for j in 0..p {
                let sum = self.crossed.column_mut(i * p + j);
                for (t, block) in theta.chunks_exact(n).enumerate() {
                    let weight = self.rows.at(t, j);
                    if weight != S::zero() {
                        axpy(weight, block, sum);
                    }
                }
            }
            axpy(one, self.crossed.column(i * p + i), &mut transition.drift);
        }
        for i in 0..p {
            for j in 0..p {
                self.swapped.column_mut(i * p + j).copy_from_slice(self.crossed.column(j * p + i));
            }
        }
        S::symmetric_product_lower(transition.qbar.view_mut(), one, self.crossed.view(), self.swapped.view());
    }
}

impl<S: Kernels> Expectation for MomentMatched<S> {
    const FLOPS: fn(&StepSize, &FormFacts) -> Vec<Term> = |size, form| {
        let (n, p, c) = (size.n, size.p, size.columns());
        // Given the measurement, the noises of the outputs are correlated through P, and those of the inputs are
        // correlated with them through R.
        let pairs = if size.full_noise { c * (c - 1.0) / 2.0 } else { p * (p - 1.0) / 2.0 };
        let mut terms = noise_flops(size, form);
        terms.extend((form.parameter_blocks)(size, pairs));
        terms.extend((form.output_columns)(size));
        // E_ij E_ji^T for each pair of outputs, with one triangle each.
        terms.push(Term { what: "products of the crossed covariances", flops: p * p * n * n });
        terms
    };
}
