use nalgebra::{DMatrix, DVector};
use ndarray::{Array2, ArrayView2};

use super::error::{ModelError, expect_shape};
use super::simulate::{Bounds, expect_inputs};
use super::state_space::Model;

/// One-step predictions of a record.
#[derive(Debug, Clone, PartialEq)]
pub struct Prediction {
    /// Each output as predicted from the samples before it (samples x p).
    pub predicted: Array2<f64>,
    /// Measured output minus prediction (samples x p); NaN where the output is missing.
    pub innovations: Array2<f64>,
    /// State after the last sample (n).
    pub final_state: DVector<f64>,
}

/// Predicts each output one step ahead with the model's gain: x_{k+1} = A x_k + B u_k + K e_k, e_k = y_k - C x_k - D
/// u_k. A missing output (NaN) is treated as a zero innovation.
///
/// # Errors
/// Returns [`ModelError::Needs`] without a gain, [`ModelError::Shape`], [`ModelError::NotFinite`] for an input or an
/// infinite output, and [`ModelError::Diverged`].
pub fn one_step_prediction(
    model: &Model,
    inputs: ArrayView2<f64>,
    outputs: ArrayView2<f64>,
    initial_state: &DVector<f64>,
) -> Result<Prediction, ModelError> {
    let gain = need_gain(model)?;
    expect_inputs(model, inputs)?;
    expect_outputs(model, outputs, inputs.nrows())?;
    expect_shape("initial_state", (model.n(), 1), initial_state.shape())?;
    let mut predicted = Array2::zeros(outputs.raw_dim());
    let mut innovations = Array2::zeros(outputs.raw_dim());
    let mut state = initial_state.clone();
    let bounds = Bounds::new(model, inputs, initial_state).with_measured(outputs);
    for sample in 0..inputs.nrows() {
        let u = DVector::from_iterator(model.m(), inputs.row(sample).iter().copied());
        let y = &model.c * &state + &model.d * &u;
        bounds.expect_within(model, &y, sample)?;
        let mut correction = DVector::zeros(model.p());
        for i in 0..model.p() {
            let innovation = outputs[(sample, i)] - y[i];
            predicted[(sample, i)] = y[i];
            innovations[(sample, i)] = innovation;
            correction[i] = if innovation.is_nan() { 0.0 } else { innovation };
        }
        state = &model.a * state + &model.b * u + gain * correction;
    }
    let final_state = state;
    Ok(Prediction { predicted, innovations, final_state })
}

/// Returns the predictor as a model with inputs [u; y]: x_{k+1} = (A - K C) x_k + (B - K D) u_k + K y_k. Its simulation
/// equals the one-step prediction of a record without missing outputs.
///
/// # Errors
/// Returns [`ModelError::Needs`] without a gain, and [`ModelError::Key`] if an input and an output share a name.
pub fn predictor(model: &Model) -> Result<Model, ModelError> {
    let gain = need_gain(model)?;
    let (m, p) = (model.m(), model.p());
    let b = &model.b - gain * &model.d;
    let mut all = Model::new(
        model.sample_rate_hz,
        &model.a - gain * &model.c,
        DMatrix::from_fn(model.n(), m + p, |i, j| if j < m { b[(i, j)] } else { gain[(i, j - m)] }),
        model.c.clone(),
        model.d.clone().resize_horizontally(m + p, 0.0),
    )?;
    all.inputs = [model.inputs.clone(), model.outputs.clone()].concat();
    all.outputs.clone_from(&model.outputs);
    all.check("the predictor")?;
    Ok(all)
}

fn need_gain(model: &Model) -> Result<&DMatrix<f64>, ModelError> {
    model.predictor_gain.as_ref().ok_or(ModelError::Needs { key: "predictor_gain", purpose: "one-step prediction" })
}

/// Returns an error unless `outputs` is samples x p and free of infinities; NaN marks a missing output.
pub(super) fn expect_outputs(model: &Model, outputs: ArrayView2<f64>, samples: usize) -> Result<(), ModelError> {
    expect_shape("outputs", (samples, model.p()), outputs.dim())?;
    let position = outputs.indexed_iter().find(|(_, y)| y.is_infinite());
    position.map_or(Ok(()), |((sample, channel), _)| {
        let channel = model.outputs[channel].clone();
        Err(ModelError::NotFinite { channel, sample })
    })
}

#[cfg(test)]
mod tests {
    use super::super::simulate::simulate;
    use super::super::testing::{random, record, two_modes};
    use super::*;
    use approx::assert_relative_eq;
    use ndarray::{Axis, concatenate};

    fn with_gain() -> Model {
        let mut model = two_modes();
        model.d = random(8, 2, 2);
        model.predictor_gain = Some(random(9, 4, 2) * 0.2);
        model
    }

    #[test]
    fn the_innovations_that_drove_a_record_are_found_again() {
        let model = with_gain();
        let (u, e) = (record(1, 80, 2), record(2, 80, 2));
        let gain = model.predictor_gain.as_ref().unwrap();
        // In innovations form the innovation is an additional input: [B K], [D I].
        let mut driven = Model::new(
            100.0,
            model.a.clone(),
            DMatrix::from_fn(4, 4, |i, j| if j < 2 { model.b[(i, j)] } else { gain[(i, j - 2)] }),
            model.c.clone(),
            DMatrix::from_fn(2, 4, |i, j| if j < 2 { model.d[(i, j)] } else { f64::from(u8::from(i == j - 2)) }),
        )
        .unwrap();
        driven.inputs = ["a", "b", "c", "d"].map(String::from).to_vec();
        let start = DVector::from_vec(vec![1.0, -1.0, 0.5, 2.0]);
        let both = concatenate![Axis(1), u, e];
        let y = simulate(&driven, both.view(), &start).unwrap().outputs;
        let run = one_step_prediction(&model, u.view(), y.view(), &start).unwrap();
        for (found, true_one) in run.innovations.iter().zip(&e) {
            assert_relative_eq!(found, true_one, epsilon = 1e-12);
        }
    }

    #[test]
    fn the_predictor_is_a_model_too() {
        let model = with_gain();
        let (u, y) = (record(3, 50, 2), record(4, 50, 2));
        let run = one_step_prediction(&model, u.view(), y.view(), &model.rest()).unwrap();
        let both = concatenate![Axis(1), u, y];
        let free = simulate(&predictor(&model).unwrap(), both.view(), &model.rest()).unwrap();
        for (a, b) in run.predicted.iter().zip(&free.outputs) {
            assert_relative_eq!(a, b, epsilon = 1e-12);
        }
    }

    #[test]
    fn without_measurements_it_is_the_free_run() {
        let model = with_gain();
        let u = record(3, 50, 2);
        let nothing = Array2::from_elem((50, 2), f64::NAN);
        let run = one_step_prediction(&model, u.view(), nothing.view(), &model.rest()).unwrap();
        let free = simulate(&model, u.view(), &model.rest()).unwrap();
        for (a, b) in run.predicted.iter().zip(&free.outputs) {
            assert_relative_eq!(a, b, epsilon = 1e-12);
        }
        assert!(run.innovations.iter().all(|e| e.is_nan()));
    }

    #[test]
    fn faults_are_told() {
        let model = with_gain();
        let (u, mut y) = (record(3, 5, 2), record(4, 5, 2));
        y[(3, 0)] = f64::INFINITY;
        let run = one_step_prediction(&model, u.view(), y.view(), &model.rest());
        assert!(matches!(run, Err(ModelError::NotFinite { channel, sample: 3 }) if channel == "y1"));
        let run = one_step_prediction(&two_modes(), u.view(), y.view(), &model.rest());
        assert!(matches!(run, Err(ModelError::Needs { .. })));
    }
}
