use nalgebra::{DMatrix, DVector};
use ndarray::{ArrayView2, Axis, concatenate};

use super::error::{ModelError, expect_shape};
use super::predict::{expect_outputs, predictor};
use super::simulate::{Bounds, expect_inputs};
use super::state_space::Model;

/// The fit ends where C A^k has grown by this factor, beyond which rounding in the simulation exceeds the information
/// in a sample.
const GROWTH_LIMIT: f64 = 1e8;
/// Directions of the initial state with a smaller singular value, relative to the largest, are set to zero.
const RANK_TOLERANCE: f64 = 1e-12;

/// A fitted initial state.
#[derive(Debug, Clone, PartialEq)]
pub struct InitialState {
    /// The state at the first sample (n).
    pub state: DVector<f64>,
    /// Number of samples used by the fit, which for an unstable model may be smaller than the window.
    pub samples: usize,
    /// Rank of the least-squares problem: n if the samples determine the whole state.
    pub rank: usize,
}

/// Estimates the initial state of a simulation by least squares: it minimises |y_k - y_forced,k - C A^k x_0|^2 summed
/// over the first `window` samples (all samples if `None`). Missing outputs (NaN) are left out.
///
/// The rows C A^k are reduced by QR in blocks. Directions that they do not determine are zero (after column scaling).
/// For an unstable model the fit ends before C A^k or the forced response becomes too large.
///
/// # Errors
/// Returns [`ModelError::Shape`] or [`ModelError::NotFinite`].
pub fn estimate_initial_state(
    model: &Model,
    inputs: ArrayView2<f64>,
    outputs: ArrayView2<f64>,
    window: Option<usize>,
) -> Result<InitialState, ModelError> {
    expect_inputs(model, inputs)?;
    expect_outputs(model, outputs, inputs.nrows())?;
    let (n, m, p) = (model.n(), model.m(), model.p());
    let mut fit = Triangle::new(n);
    let mut propagated = model.c.clone();
    let largest = propagated.amax();
    let mut forced = model.rest();
    let bounds = Bounds::new(model, inputs, &forced);
    let mut samples = 0;
    for k in 0..window.unwrap_or(usize::MAX).min(inputs.nrows()) {
        let u = DVector::from_iterator(m, inputs.row(k).iter().copied());
        let y = &model.c * &forced + &model.d * &u;
        // The comparison is written so that NaN also ends the fit.
        let within = propagated.amax() <= GROWTH_LIMIT * largest && bounds.expect_within(model, &y, k).is_ok();
        if !within {
            break;
        }
        for i in (0..p).filter(|&i| !outputs[(k, i)].is_nan()) {
            let row = propagated.row(i);
            fit.add(row.iter().copied(), outputs[(k, i)] - y[i]);
        }
        samples += 1;
        propagated *= &model.a;
        forced = &model.a * forced + &model.b * u;
    }
    let (state, rank) = fit.solve();
    Ok(InitialState { state, samples, rank })
}

/// Estimates the initial state of a one-step prediction: it minimises the sum of squared innovations over the window.
/// The first sample with a missing output ends the window.
///
/// # Errors
/// Returns the errors of [`estimate_initial_state`], and [`ModelError::Needs`] without a predictor gain.
pub fn estimate_predictor_state(
    model: &Model,
    inputs: ArrayView2<f64>,
    outputs: ArrayView2<f64>,
    window: Option<usize>,
) -> Result<InitialState, ModelError> {
    let predictor = predictor(model)?;
    expect_outputs(model, outputs, inputs.nrows())?;
    expect_shape("inputs", (inputs.nrows(), model.m()), inputs.dim())?;
    let missing = outputs.outer_iter().position(|y| y.iter().any(|y| y.is_nan()));
    let whole = missing.unwrap_or(outputs.nrows());
    let window = whole.min(window.unwrap_or(whole));
    let both = concatenate![
        Axis(1),
        inputs.slice_axis(Axis(0), (..window).into()),
        outputs.slice_axis(Axis(0), (..window).into())
    ];
    let outputs = outputs.slice_axis(Axis(0), (..window).into());
    estimate_initial_state(&predictor, both.view(), outputs, None)
}

/// Least squares by block QR: the triangle [R | d] so far, followed by the rows added since.
struct Triangle {
    /// The matrix has n + 1 columns: the unknowns and the right-hand side.
    rows: DMatrix<f64>,
    filled: usize,
    n: usize,
}

impl Triangle {
    fn new(n: usize) -> Self {
        let rows = DMatrix::zeros(8 * (n + 1), n + 1);
        Self { rows, filled: 0, n }
    }

    fn add(&mut self, row: impl Iterator<Item = f64>, right: f64) {
        if self.filled == self.rows.nrows() {
            self.reduce();
        }
        for (j, x) in row.chain([right]).enumerate() {
            self.rows[(self.filled, j)] = x;
        }
        self.filled += 1;
    }

    fn reduce(&mut self) {
        let triangle = self.rows.rows(0, self.filled).into_owned().qr().unpack_r();
        self.filled = triangle.nrows();
        self.rows.rows_mut(0, self.filled).copy_from(&triangle);
    }

    /// Returns the solution of least norm in scaled columns, and the rank.
    fn solve(mut self) -> (DVector<f64>, usize) {
        if self.filled == 0 {
            return (DVector::zeros(self.n), 0);
        }
        self.reduce();
        let triangle = self.rows.view((0, 0), (self.filled, self.n));
        let right = self.rows.view((0, self.n), (self.filled, 1));
        let norms: Vec<f64> = triangle.column_iter().map(|c| c.norm()).collect();
        let scale = |j: usize| if norms[j] > 0.0 { 1.0 / norms[j] } else { 0.0 };
        let scaled = DMatrix::from_fn(self.filled, self.n, |i, j| triangle[(i, j)] * scale(j));
        let svd = scaled.svd(true, true);
        let smallest = svd.singular_values.max() * RANK_TOLERANCE;
        let (Some(u), Some(vt)) = (svd.u, svd.v_t) else {
            return (DVector::zeros(self.n), 0);
        };
        let mut solution = DVector::zeros(self.n);
        let mut rank = 0;
        for (k, &value) in svd.singular_values.iter().enumerate() {
            if value > smallest {
                let weight = u.column(k).dot(&right.column(0)) / value;
                solution += vt.row(k).transpose() * weight;
                rank += 1;
            }
        }
        solution.iter_mut().enumerate().for_each(|(j, x)| *x *= scale(j));
        (solution, rank)
    }
}

#[cfg(test)]
mod tests {
    use super::super::predict::one_step_prediction;
    use super::super::simulate::simulate;
    use super::super::testing::{canonical, random, record, two_modes};
    use super::*;
    use approx::assert_relative_eq;

    fn start() -> DVector<f64> {
        DVector::from_vec(vec![0.3, -2.0, 1.0, 0.7])
    }

    fn found(model: &Model, samples: usize) -> InitialState {
        let u = record(1, samples, 2);
        let y = simulate(model, u.view(), &start()).unwrap().outputs;
        estimate_initial_state(model, u.view(), y.view(), None).unwrap()
    }

    #[test]
    fn a_lightly_damped_start_is_found_exactly() {
        let fit = found(&two_modes(), 3000);
        assert_relative_eq!(fit.state, start(), epsilon = 1e-11);
        assert_eq!((fit.samples, fit.rank), (3000, 4));
    }

    #[test]
    fn a_slightly_unstable_start_is_found_and_the_window_ends_in_time() {
        let mut model = two_modes();
        model.a *= 1.03;
        let fit = found(&model, 1000);
        assert_relative_eq!(fit.state, start(), epsilon = 1e-6);
        assert!((500..1000).contains(&fit.samples), "{}", fit.samples);
        model.a *= 1e3;
        let u = record(1, 1000, 2);
        let fit = estimate_initial_state(&model, u.view(), u.view(), None).unwrap();
        assert!(fit.state.iter().all(|x| x.is_finite()) && fit.samples < 10);
    }

    #[test]
    fn with_noise_it_solves_the_normal_equations() {
        let model = canonical(4, &[2, 1], 1);
        let (u, y) = (record(1, 40, 1), record(2, 40, 2));
        let fit = estimate_initial_state(&model, u.view(), y.view(), Some(30)).unwrap();
        let forced = simulate(&model, u.view(), &model.rest()).unwrap().outputs;
        let (mut normal, mut right) = (DMatrix::zeros(3, 3), DVector::zeros(3));
        let mut propagated = model.c.clone();
        for k in 0..30 {
            let error = DVector::from_fn(2, |i, _| y[(k, i)] - forced[(k, i)]);
            normal += propagated.transpose() * &propagated;
            right += propagated.transpose() * error;
            propagated *= &model.a;
        }
        let expected = normal.lu().solve(&right).unwrap();
        assert_relative_eq!(fit.state, expected, epsilon = 1e-10);
    }

    #[test]
    fn missing_outputs_are_left_out_and_what_is_not_seen_stays_zero() {
        let mut model = two_modes();
        model.c.columns_mut(2, 2).fill(0.0);
        let u = record(1, 300, 2);
        let mut y = simulate(&model, u.view(), &start()).unwrap().outputs;
        y.row_mut(5).fill(f64::NAN);
        y[(17, 1)] = f64::NAN;
        let fit = estimate_initial_state(&model, u.view(), y.view(), None).unwrap();
        let seen = DVector::from_vec(vec![0.3, -2.0, 0.0, 0.0]);
        assert_relative_eq!(fit.state, seen, epsilon = 1e-10);
        assert_eq!(fit.rank, 2);
        let nothing = y.mapv(|_| f64::NAN);
        let fit = estimate_initial_state(&model, u.view(), nothing.view(), None).unwrap();
        assert_eq!((fit.state, fit.rank), (model.rest(), 0));
    }

    #[test]
    fn the_start_of_a_prediction_is_found() {
        let mut model = two_modes();
        model.predictor_gain = Some(random(9, 4, 2) * 0.1);
        let u = record(1, 200, 2);
        let y = simulate(&model, u.view(), &start()).unwrap().outputs;
        let fit = estimate_predictor_state(&model, u.view(), y.view(), None).unwrap();
        assert_relative_eq!(fit.state, start(), epsilon = 1e-10);
        let run = one_step_prediction(&model, u.view(), y.view(), &fit.state).unwrap();
        assert!(run.innovations.iter().all(|e| e.abs() < 1e-10));
    }
}
