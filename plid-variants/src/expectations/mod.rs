//! The conditional expectations, one file each. The choice among them is the user's.
//!
//! "Minus" denotes a quantity before the measurement z_k, and "plus" one after it.

mod certainty_equivalent;
mod joint_ekf;
mod moment_matched;
mod posterior;
mod prior;

pub use certainty_equivalent::CertaintyEquivalent;
pub use joint_ekf::JointEkf;
pub use moment_matched::MomentMatched;
pub use posterior::Posterior;
pub use prior::Prior;

use plid_core::kernels::{Kernels, axpy};
use plid_core::{Dense, FormFacts, ImplicitModel, Matrix, Scalar, StepSize, StepView, Term, Transition};

/// Returns column t of the parameters in s, which are a_1 .. a_p followed by b_1 .. b_m.
fn parameter<S>(s: &[S], n: usize, t: usize) -> &[S] {
    &s[(1 + t) * n..(2 + t) * n]
}

/// Computes the effect of the noise given w, with E[G] from the parameters of `step.s`. It gives the columns of Abar,
/// which are a_i - (B L + M)_i, or a_i if output i is missing, and Qbar = Sigma' + B Q' B^T + B S' + (B S')^T, which
/// is E[G] (Q0 - S R^-1 S^T) E[G]^T.
fn condition_on_sensor_noise<S: Kernels>(
    step: &StepView<'_, S>,
    scratch: &mut Scratch<S>,
    transition: &mut Transition<S>,
) {
    let StepView { model, noise, s, .. } = step;
    let (n, m, p) = (model.states(), model.inputs(), model.outputs());
    for i in 0..p {
        transition.abar.column_mut(i).copy_from_slice(parameter(s, n, i));
    }
    for (k, &i) in noise.available().iter().enumerate() {
        let column = transition.abar.column_mut(i);
        axpy(-S::one(), noise.m().column(k), column);
        for j in 0..m {
            axpy(-noise.l().at(j, k), parameter(s, n, p + j), column);
        }
    }
    for c in 0..n {
        transition.qbar.column_mut(c).copy_from_slice(noise.state_given().column(c));
    }
    // With T_j = (B Q')_j / 2 + S'_j, the remaining terms are the sum of b_j T_j^T and its transpose.
    let half = S::from_f64(0.5);
    for j in 0..m {
        let b = parameter(s, n, p + j);
        scratch.left.column_mut(j).copy_from_slice(b);
        scratch.right.column_mut(m + j).copy_from_slice(b);
        let sum = scratch.right.column_mut(j);
        for (c, x) in sum.iter_mut().enumerate() {
            *x = noise.actuator_state_given().at(j, c);
        }
        for l in 0..m {
            let weight = noise.actuator_given().at(l, j);
            if weight != S::zero() {
                axpy(half * weight, parameter(s, n, p + l), sum);
            }
        }
        scratch.left.column_mut(m + j).copy_from_slice(scratch.right.column(j));
    }
    S::symmetric_product_lower(transition.qbar.view_mut(), S::one(), scratch.left.view(), scratch.right.view());
}

/// Two factors of a symmetric product, n x 2m each.
#[derive(Clone, Debug)]
struct Scratch<S> {
    left: Dense<S>,
    right: Dense<S>,
}

impl<S: Scalar> Scratch<S> {
    fn new(model: &dyn ImplicitModel) -> Self {
        let (n, m) = (model.states(), model.inputs());
        Self { left: Dense::zeros(n, 2 * m), right: Dense::zeros(n, 2 * m) }
    }
}

/// Computes the weights of the parameters' covariances if E[.] is not conditioned on z_k. They are Q0_ab sigma_a
/// sigma_b with sigma = -1 for w and +1 for v, and zero for missing outputs.
fn unconditioned_weights<S: Scalar>(step: &StepView<'_, S>, weights: &mut Dense<S>) {
    let noise = step.noise;
    let (p, m) = (step.model.outputs(), step.model.inputs());
    weights.fill(S::zero());
    for (k, &i) in noise.available().iter().enumerate() {
        for (l, &j) in noise.available().iter().enumerate() {
            *weights.at_mut(i, j) = noise.sensor(k, l);
        }
        for j in 0..m {
            let covariance = noise.actuator_sensor().at(j, i);
            *weights.at_mut(i, p + j) = -covariance;
            *weights.at_mut(p + j, i) = -covariance;
        }
    }
    for j in 0..m {
        for l in 0..m {
            *weights.at_mut(p + j, p + l) = noise.actuator().at(j, l);
        }
    }
}

/// Sets phi = [z; u], with x+_{c_i} in place of a missing z_i, and d = E[G] S R^-1 (z - C x+), which is the sum of
/// -abar_i r_i.
fn regress_on_measurement<S: Scalar>(step: &StepView<'_, S>, transition: &mut Transition<S>) {
    let StepView { model, noise, s, z, u, residual } = step;
    let p = model.outputs();
    for (i, &row) in model.output_states().iter().enumerate() {
        transition.phi[i] = s[row];
    }
    transition.phi[p..].copy_from_slice(u);
    transition.drift.fill(S::zero());
    for (&i, &r) in noise.available().iter().zip(*residual) {
        transition.phi[i] = z[i];
        axpy(-r, transition.abar.column(i), &mut transition.drift);
    }
}

/// Sets phi = [C x+; u + L r] and d = M r.
fn regress_on_estimate<S: Scalar>(step: &StepView<'_, S>, transition: &mut Transition<S>) {
    let StepView { model, noise, s, u, residual, .. } = step;
    let p = model.outputs();
    for (i, &row) in model.output_states().iter().enumerate() {
        transition.phi[i] = s[row];
    }
    for (j, &u) in u.iter().enumerate() {
        transition.phi[p + j] = residual.iter().enumerate().fold(u, |sum, (k, &r)| sum + noise.l().at(j, k) * r);
    }
    transition.drift.fill(S::zero());
    for (k, &r) in residual.iter().enumerate() {
        axpy(r, noise.m().column(k), &mut transition.drift);
    }
}

/// Counts b_j (half b_j Q' + S')^T and its transpose for each input, with one triangle each.
fn noise_flops(size: &StepSize, _form: &FormFacts) -> Vec<Term> {
    vec![Term { what: "B Q' B^T", flops: 2.0 * size.m * size.n * size.n }]
}

/// Returns the terms of [`noise_flops`] and those of the blocks of P. A pair of parameter columns counts only if
/// their noises are correlated.
fn unconditioned_flops(size: &StepSize, form: &FormFacts) -> Vec<Term> {
    let c = size.columns();
    let pairs = if size.full_noise { c * (c - 1.0) / 2.0 } else { 0.0 };
    let mut terms = noise_flops(size, form);
    terms.extend((form.parameter_blocks)(size, pairs));
    terms
}
