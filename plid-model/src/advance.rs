use nalgebra::DVector;

use super::error::{ModelError, expect_shape};
use super::state_space::Model;

/// Converts a model that was identified with its inputs advanced by one sample. The identified model receives u_{k+1}
/// in place of u_k: x_{k+1} = A x_k + B u_{k+1} + K e_k, y_k = C x_k. With x'_k = x_k - B u_k it becomes x'_{k+1} = A
/// x'_k + A B u_k + K e_k, y_k = C x'_k + C B u_k. A, C and K are unchanged, B becomes A B, and D becomes C B
/// (docs/mathematics.md, "The plant").
///
/// The parameter covariance remains that of the identified (A, B); [`super::response_variance`] expects this with
/// `advance` = 1. An initial state x_0 becomes x_0 - B u_0, where `first_input` is u_0; it is dropped if `first_input`
/// is `None`. `continuous` and `ports` are dropped, because they have no meaning for advanced inputs.
///
/// # Errors
/// Returns [`ModelError::Needs`] if D is not zero (y_k would depend on u_{k+1}), and [`ModelError::Shape`].
pub fn undo_advance(model: &Model, first_input: Option<&[f64]>) -> Result<Model, ModelError> {
    if model.d.iter().any(|&d| d != 0.0) {
        return Err(ModelError::Needs { key: "D = 0", purpose: "undoing the input advance" });
    }
    let state = model.initial_state.as_ref().zip(first_input);
    let initial_state = state.map(|(x, u)| advanced_state(model, x, u)).transpose()?;
    Ok(Model {
        b: &model.a * &model.b,
        d: &model.c * &model.b,
        initial_state,
        continuous: None,
        ports: Vec::new(),
        ..model.clone()
    })
}

/// Returns x'_k = x_k - B u_k, the state of the model of [`undo_advance`] that corresponds to the state x_k of the
/// identified `model`; `input` is u_k.
///
/// # Errors
/// Returns [`ModelError::Shape`].
pub fn advanced_state(model: &Model, state: &DVector<f64>, input: &[f64]) -> Result<DVector<f64>, ModelError> {
    expect_shape("state", (model.n(), 1), state.shape())?;
    expect_shape("input", (model.m(), 1), (input.len(), 1))?;
    Ok(state - &model.b * DVector::from_column_slice(input))
}

#[cfg(test)]
mod tests {
    use super::super::predict::one_step_prediction;
    use super::super::simulate::simulate;
    use super::super::testing::{canonical, random, record};
    use super::*;
    use approx::assert_relative_eq;
    use ndarray::{Array2, s};

    fn equal(a: &Array2<f64>, b: &Array2<f64>) {
        assert_eq!(a.dim(), b.dim());
        for (a, b) in a.iter().zip(b) {
            assert_relative_eq!(a, b, epsilon = 1e-12);
        }
    }

    #[test]
    fn runs_and_predictions_agree() {
        let mut model = canonical(6, &[2, 2], 2);
        model.predictor_gain = Some(random(2, 4, 2) * 0.2);
        let start = DVector::from_vec(vec![1.0, 2.0, -1.0, 0.5]);
        model.initial_state = Some(start.clone());
        let (u, y) = (record(1, 61, 2), record(2, 60, 2));
        let (now, next) = (u.slice(s![..60, ..]), u.slice(s![1.., ..]));
        let first = [u[(0, 0)], u[(0, 1)]];
        let undone = undo_advance(&model, Some(&first)).unwrap();
        let other = undone.initial_state.clone().unwrap();

        let before = simulate(&model, next, &start).unwrap();
        let after = simulate(&undone, now, &other).unwrap();
        equal(&before.outputs, &after.outputs);
        let last = [u[(60, 0)], u[(60, 1)]];
        let end = advanced_state(&model, &before.final_state, &last).unwrap();
        assert_relative_eq!(after.final_state, end, epsilon = 1e-12);

        let before = one_step_prediction(&model, next, y.view(), &start).unwrap();
        let after = one_step_prediction(&undone, now, y.view(), &other).unwrap();
        equal(&before.innovations, &after.innovations);
    }

    #[test]
    fn an_answer_to_the_future_is_refused() {
        let mut model = canonical(6, &[2], 1);
        model.d[(0, 0)] = 1.0;
        assert!(matches!(undo_advance(&model, None), Err(ModelError::Needs { .. })));
    }
}
