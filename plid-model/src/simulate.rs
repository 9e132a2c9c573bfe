use nalgebra::{DVector, Dyn, MatrixView, U1};
use ndarray::{Array2, ArrayView2};

use super::error::{ModelError, expect_shape};
use super::state_space::Model;

/// An output counts as diverged if it exceeds what a single sample of the input or the initial state can cause by
/// more than this factor. No stable model of practical use comes near this bound, and beyond it no digit of the
/// initial state is left.
pub const DIVERGENCE_FACTOR: f64 = 1e15;

/// The result of a free-run simulation.
#[derive(Debug, Clone, PartialEq)]
pub struct Simulation {
    /// Simulated outputs (samples x p).
    pub outputs: Array2<f64>,
    /// State after the last sample (n).
    pub final_state: DVector<f64>,
}

/// Simulates the model with `inputs` (samples x m) from `initial_state` (n); [`Model::rest`] is the zero state.
///
/// # Errors
/// Returns [`ModelError::Shape`], [`ModelError::NotFinite`] for an input, and [`ModelError::Diverged`] with the first
/// sample at which an output is not finite or exceeds [`DIVERGENCE_FACTOR`] times what one sample can cause.
pub fn simulate(
    model: &Model,
    inputs: ArrayView2<f64>,
    initial_state: &DVector<f64>,
) -> Result<Simulation, ModelError> {
    expect_inputs(model, inputs)?;
    expect_shape("initial_state", (model.n(), 1), initial_state.shape())?;
    let mut outputs = Array2::zeros((inputs.nrows(), model.p()));
    let mut state = initial_state.clone();
    let mut next = model.rest();
    let bounds = Bounds::new(model, inputs, initial_state);
    let (mut u, mut y) = (DVector::zeros(model.m()), DVector::zeros(model.p()));
    for (sample, row) in inputs.outer_iter().enumerate() {
        u.iter_mut().zip(row).for_each(|(to, from)| *to = *from);
        y.gemv(1.0, &model.c, &state, 0.0);
        y.gemv(1.0, &model.d, &u, 1.0);
        bounds.expect_within(model, &y, sample)?;
        outputs.row_mut(sample).iter_mut().zip(&y).for_each(|(to, from)| *to = *from);
        next.gemv(1.0, &model.a, &state, 0.0);
        next.gemv(1.0, &model.b, &u, 1.0);
        std::mem::swap(&mut state, &mut next);
    }
    let final_state = state;
    Ok(Simulation { outputs, final_state })
}

/// Returns an error unless `inputs` is samples x m and finite.
pub(super) fn expect_inputs(model: &Model, inputs: ArrayView2<f64>) -> Result<(), ModelError> {
    expect_shape("inputs", (inputs.nrows(), model.m()), inputs.dim())?;
    let position = inputs.indexed_iter().find(|(_, x)| !x.is_finite());
    position.map_or(Ok(()), |((sample, channel), _)| {
        let channel = model.inputs[channel].clone();
        Err(ModelError::NotFinite { channel, sample })
    })
}

/// One row of a matrix.
type RowView<'a> = MatrixView<'a, f64, U1, Dyn, U1, Dyn>;

/// The magnitude of each output beyond which a run counts as diverged. It grows with the inputs and the initial state,
/// so it does not depend on the units of the model.
pub(super) struct Bounds(Vec<f64>);

impl Bounds {
    /// Bounds |y_i| by [`DIVERGENCE_FACTOR`] times what an input sample of the largest magnitude u and a state of
    /// magnitude b u + x_0 can cause, where b is the largest row sum of |B|.
    pub(super) fn new(model: &Model, inputs: ArrayView2<f64>, initial_state: &DVector<f64>) -> Self {
        // Magnitudes are added and not squared, so that no unit makes them overflow or underflow.
        let size = |row: RowView<'_>| row.iter().map(|x| x.abs()).sum::<f64>();
        let largest = inputs.iter().fold(0.0_f64, |largest, u| largest.max(u.abs()));
        let state = initial_state.amax() + largest * model.b.row_iter().map(size).fold(0.0, f64::max);
        let one_sample = |i: usize| size(model.c.row(i)) * state + size(model.d.row(i)) * largest;
        Self((0..model.p()).map(|i| DIVERGENCE_FACTOR * one_sample(i)).collect())
    }

    /// Widens the bounds by the largest measured output, which a predictor feeds back.
    pub(super) fn with_measured(self, outputs: ArrayView2<f64>) -> Self {
        let largest = outputs.iter().filter(|y| !y.is_nan()).fold(0.0_f64, |largest, y| largest.max(y.abs()));
        Self(self.0.iter().map(|bound| bound + DIVERGENCE_FACTOR * largest).collect())
    }

    /// Returns an error unless every output is finite and within its bound.
    pub(super) fn expect_within(&self, model: &Model, outputs: &DVector<f64>, sample: usize) -> Result<(), ModelError> {
        // A comparison with NaN is false, and NaN must count as diverged.
        let within = |(y, bound): (&f64, &f64)| y.is_finite() && y.abs() <= *bound;
        outputs.iter().zip(&self.0).position(|pair| !within(pair)).map_or(Ok(()), |i| {
            Err(ModelError::Diverged { output: model.outputs[i].clone(), sample, bound: self.0[i] })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{canonical, in_other_states, pole, random, record, two_modes};
    use super::*;
    use approx::assert_relative_eq;
    use nalgebra::DMatrix;
    use ndarray::array;
    use proptest::prelude::*;

    #[test]
    fn a_free_decay_has_its_closed_form() {
        let model = two_modes();
        let start = DVector::from_vec(vec![1.0, 0.0, 0.0, 0.0]);
        let run = simulate(&model, Array2::zeros((200, 2)).view(), &start).unwrap();
        let (radius, angle) = pole(12.0, 0.01, 100.0);
        for k in 0..200 {
            // The block [re im; -im re] maps (1, 0) to radius^k (cos, -sin).
            let (size, phase) = (radius.powi(k as i32), angle * k as f64);
            let closed = model.c[(1, 0)] * size * phase.cos() - model.c[(1, 1)] * size * phase.sin();
            assert_relative_eq!(run.outputs[(k, 1)], closed, epsilon = 1e-12);
        }
    }

    #[test]
    fn a_unit_step_of_a_lag_has_its_closed_form() {
        let one = |x| DMatrix::from_element(1, 1, x);
        let model = Model::new(1.0, one(0.9), one(0.2), one(3.0), one(0.5)).unwrap();
        let run = simulate(&model, Array2::ones((50, 1)).view(), &model.rest()).unwrap();
        for k in 0..50 {
            let closed = 0.5 + 3.0 * 0.2 * (1.0 - 0.9_f64.powi(k as i32)) / 0.1;
            assert_relative_eq!(run.outputs[(k, 0)], closed, max_relative = 1e-13);
        }
        let end = 0.2 * (1.0 - 0.9_f64.powi(50)) / 0.1;
        assert_relative_eq!(run.final_state[0], end, max_relative = 1e-13);
    }

    #[test]
    fn divergence_is_found_at_its_sample() {
        let one = |x| DMatrix::from_element(1, 1, x);
        let model = Model::new(1.0, one(2.0), one(0.0), one(1.0), one(0.0)).unwrap();
        let start = DVector::from_element(1, 1.0);
        let error = simulate(&model, Array2::zeros((2000, 1)).view(), &start).unwrap_err();
        // 2^50 is the first power of two above 1e15.
        assert!(matches!(error, ModelError::Diverged { sample: 50, .. }));
    }

    #[test]
    fn divergence_does_not_depend_on_units() {
        let one = |x| DMatrix::from_element(1, 1, x);
        let lag = Model::new(1.0, one(0.5), one(1.0), one(1.0), one(0.0)).unwrap();
        let large = Array2::from_elem((50, 1), 1e18);
        let run = simulate(&lag, large.view(), &lag.rest()).unwrap();
        assert_relative_eq!(run.outputs[(49, 0)], 2e18, max_relative = 1e-9);
        for unit in [1e-200, 1e-20, 1e20, 1e200] {
            let model = Model::new(1.0, one(2.0), one(1.0), one(1.0), one(0.0)).unwrap();
            let step = Array2::from_elem((2000, 1), unit);
            let error = simulate(&model, step.view(), &model.rest()).unwrap_err();
            assert!(matches!(error, ModelError::Diverged { sample: 50, .. }), "{unit:e}: {error}");
        }
    }

    #[test]
    fn bad_inputs_are_told_by_channel_and_sample() {
        let model = two_modes();
        let mut inputs = record(1, 10, 2);
        inputs[(7, 1)] = f64::NAN;
        let error = simulate(&model, inputs.view(), &model.rest()).unwrap_err();
        assert!(matches!(error, ModelError::NotFinite { channel, sample: 7 } if channel == "u2"));
        let narrow = array![[1.0], [2.0]];
        assert!(matches!(simulate(&model, narrow.view(), &model.rest()), Err(ModelError::Shape { .. })));
        let empty = simulate(&model, Array2::zeros((0, 2)).view(), &model.rest()).unwrap();
        assert_eq!(empty.outputs.dim(), (0, 2));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn a_change_of_state_changes_nothing_outside(
            seed in 0_u64..1 << 40,
            indices in prop::collection::vec(1_usize..4, 1..4),
            m in 1_usize..4,
        ) {
            let model = canonical(seed, &indices, m);
            let n = model.n();
            let (other, change) = in_other_states(&model, seed + 9);
            let inputs = record(seed, 60, m);
            let start = random(seed + 3, n, 1).column(0).into_owned();
            let one = simulate(&model, inputs.view(), &start).unwrap();
            let two = simulate(&other, inputs.view(), &(&change * start)).unwrap();
            for (a, b) in one.outputs.iter().zip(&two.outputs) {
                prop_assert!((a - b).abs() < 1e-10);
            }
        }
    }
}
