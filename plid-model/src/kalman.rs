use nalgebra::{DMatrix, DVector};
use ndarray::{Array2, ArrayView2};

use super::error::{ModelError, expect_shape};
use super::predict::expect_outputs;
use super::simulate::{Bounds, expect_inputs};
use super::state_space::Model;

/// Eigenvalues of an output covariance (scaled to a unit diagonal) below this count as zero.
const SINGULAR: f64 = 1e-13;
/// Tolerance on the symmetry and semidefiniteness of a covariance, relative to its largest entry.
const COVARIANCE_TOLERANCE: f64 = 1e-9;

/// The noise covariances of x_{k+1} = A x_k + B u_k + w_k, y_k = C x_k + D u_k + v_k.
#[derive(Debug, Clone, PartialEq)]
pub struct NoiseCovariances {
    /// Covariance of the process noise w (n x n).
    pub process: DMatrix<f64>,
    /// Covariance of the sensor noise v (p x p).
    pub sensor: DMatrix<f64>,
    /// Cross-covariance E[w v^T] (n x p).
    pub cross: DMatrix<f64>,
}

impl NoiseCovariances {
    /// Returns the covariances of process and sensor noise that are independent of each other.
    pub fn independent(process: DMatrix<f64>, sensor: DMatrix<f64>) -> Self {
        let cross = DMatrix::zeros(process.nrows(), sensor.nrows());
        Self { process, sensor, cross }
    }

    /// Checks that the sizes are those of the model and that the joint matrix is a covariance.
    ///
    /// # Errors
    /// Returns [`ModelError::Shape`] or [`ModelError::NotCovariance`].
    pub fn check(&self, model: &Model) -> Result<(), ModelError> {
        let (n, p) = (model.n(), model.p());
        expect_shape("process", (n, n), self.process.shape())?;
        expect_shape("sensor", (p, p), self.sensor.shape())?;
        expect_shape("cross", (n, p), self.cross.shape())?;
        let mut all = DMatrix::zeros(n + p, n + p);
        all.view_mut((0, 0), (n, n)).copy_from(&self.process);
        all.view_mut((n, n), (p, p)).copy_from(&self.sensor);
        all.view_mut((0, n), (n, p)).copy_from(&self.cross);
        all.view_mut((n, 0), (p, n)).copy_from(&self.cross.transpose());
        expect_covariance("the joint noise matrix", &all)
    }
}

/// The result of a Kalman filter run over a record.
#[derive(Debug, Clone, PartialEq)]
pub struct Filtered {
    /// Measured output minus prediction (samples x p); NaN where the output is missing.
    pub innovations: Array2<f64>,
    /// The standard deviation of each innovation according to the filter (samples x p).
    pub innovation_std: Array2<f64>,
    /// Predicted state after the last sample (n).
    pub final_state: DVector<f64>,
    /// Covariance of that state (n x n).
    pub final_covariance: DMatrix<f64>,
}

/// Runs the time-varying Kalman filter of a fixed model, in predictor form and with correlated noise, from an initial
/// state with covariance `initial_covariance`: K = (A P C^T + S)(C P C^T + R)^{-1}, P <- (A - K C) P (A - K C)^T + [I,
/// -K] [Q S; S^T R] [I, -K]^T, a form that keeps P positive semidefinite. For missing outputs (NaN) the corresponding
/// rows of C and R and columns of S are left out.
///
/// # Errors
/// Returns [`ModelError::Shape`], [`ModelError::NotCovariance`], [`ModelError::NotFinite`] or [`ModelError::Diverged`].
pub fn kalman_filter(
    model: &Model,
    noise: &NoiseCovariances,
    inputs: ArrayView2<f64>,
    outputs: ArrayView2<f64>,
    initial_state: &DVector<f64>,
    initial_covariance: &DMatrix<f64>,
) -> Result<Filtered, ModelError> {
    let (n, m, p) = (model.n(), model.m(), model.p());
    expect_inputs(model, inputs)?;
    expect_outputs(model, outputs, inputs.nrows())?;
    noise.check(model)?;
    expect_shape("initial_state", (n, 1), initial_state.shape())?;
    expect_shape("initial_covariance", (n, n), initial_covariance.shape())?;
    expect_covariance("initial_covariance", initial_covariance)?;
    let mut innovations = Array2::from_elem(outputs.raw_dim(), f64::NAN);
    let mut innovation_std = Array2::zeros(outputs.raw_dim());
    let mut state = initial_state.clone();
    let mut covariance = initial_covariance.clone();
    let bounds = Bounds::new(model, inputs, initial_state).with_measured(outputs);
    for k in 0..inputs.nrows() {
        let u = DVector::from_iterator(m, inputs.row(k).iter().copied());
        let predicted = &model.c * &state + &model.d * &u;
        bounds.expect_within(model, &predicted, k)?;
        let all = &model.c * &covariance * model.c.transpose() + &noise.sensor;
        for i in 0..p {
            innovations[(k, i)] = outputs[(k, i)] - predicted[i];
            innovation_std[(k, i)] = all[(i, i)].max(0.0).sqrt();
        }
        let there: Vec<usize> = (0..p).filter(|&i| !outputs[(k, i)].is_nan()).collect();
        let seen = Seen::of(model, noise, &there);
        let error = DVector::from_iterator(there.len(), there.iter().map(|&i| innovations[(k, i)]));
        let gain = seen.gain(model, &covariance);
        covariance = seen.next_covariance(model, noise, &covariance, &gain);
        state = &model.a * state + &model.b * u + gain * error;
    }
    Ok(Filtered { innovations, innovation_std, final_state: state, final_covariance: covariance })
}

/// The rows of C, R and S that belong to the outputs present at a sample.
pub(super) struct Seen {
    c: DMatrix<f64>,
    sensor: DMatrix<f64>,
    cross: DMatrix<f64>,
}

impl Seen {
    pub(super) fn of(model: &Model, noise: &NoiseCovariances, there: &[usize]) -> Self {
        Self {
            c: model.c.select_rows(there),
            sensor: noise.sensor.select_rows(there).select_columns(there),
            cross: noise.cross.select_columns(there),
        }
    }

    pub(super) fn gain(&self, model: &Model, covariance: &DMatrix<f64>) -> DMatrix<f64> {
        let seen = covariance * self.c.transpose();
        let innovation = &self.c * &seen + &self.sensor;
        (&model.a * seen + &self.cross) * pseudo_inverse(&innovation)
    }

    pub(super) fn next_covariance(
        &self,
        model: &Model,
        noise: &NoiseCovariances,
        covariance: &DMatrix<f64>,
        gain: &DMatrix<f64>,
    ) -> DMatrix<f64> {
        let closed = &model.a - gain * &self.c;
        let crossed = &self.cross * gain.transpose();
        let next = &closed * covariance * closed.transpose() + &noise.process + gain * &self.sensor * gain.transpose()
            - &crossed
            - crossed.transpose();
        symmetric(&next)
    }
}

/// Returns the pseudo-inverse of an output covariance; directions without variance get no weight.
fn pseudo_inverse(covariance: &DMatrix<f64>) -> DMatrix<f64> {
    let size = covariance.nrows();
    // The covariance is scaled to a unit diagonal, so that the units do not decide which eigenvalues count as zero.
    let scale = DVector::from_fn(size, |i, _| {
        let variance = covariance[(i, i)];
        if variance > 0.0 { variance.sqrt().recip() } else { 0.0 }
    });
    let scaled = DMatrix::from_fn(size, size, |i, j| covariance[(i, j)] * scale[i] * scale[j]);
    let eigen = scaled.symmetric_eigen();
    let mut inverse = DMatrix::zeros(size, size);
    for (k, &value) in eigen.eigenvalues.iter().enumerate() {
        if value > SINGULAR {
            let direction = eigen.eigenvectors.column(k).component_mul(&scale);
            inverse += &direction * direction.transpose() / value;
        }
    }
    inverse
}

/// Returns the symmetric part.
pub(super) fn symmetric(matrix: &DMatrix<f64>) -> DMatrix<f64> {
    (matrix + matrix.transpose()) * 0.5
}

fn expect_covariance(what: &'static str, matrix: &DMatrix<f64>) -> Result<(), ModelError> {
    let fault = Err(ModelError::NotCovariance { what });
    if matrix.iter().any(|x| !x.is_finite()) {
        return fault;
    }
    let allowed = matrix.amax() * COVARIANCE_TOLERANCE;
    let asymmetry = (matrix - matrix.transpose()).amax();
    if asymmetry > allowed || symmetric(matrix).symmetric_eigenvalues().min() < -allowed {
        return fault;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::predict::one_step_prediction;
    use super::super::riccati::steady_state_gain;
    use super::super::testing::{canonical, covariance, record, two_modes};
    use super::*;
    use approx::assert_relative_eq;

    fn joint_noise(seed: u64, n: usize, p: usize) -> NoiseCovariances {
        let all = covariance(seed, n + p);
        NoiseCovariances {
            process: all.view((0, 0), (n, n)).into_owned(),
            sensor: all.view((n, n), (p, p)).into_owned(),
            cross: all.view((0, n), (n, p)).into_owned(),
        }
    }

    /// The expected state after three samples, given all measurements, follows from conditioning the joint Gaussian
    /// distribution of all variables.
    #[test]
    fn it_is_the_conditional_mean_of_a_joint_gaussian() {
        let model = canonical(3, &[2, 1], 1);
        let noise = joint_noise(5, 3, 2);
        let prior = covariance(6, 3);
        let (u, mut y) = (record(1, 3, 1), record(2, 3, 2));
        y[(1, 0)] = f64::NAN;
        let run = kalman_filter(&model, &noise, u.view(), y.view(), &model.rest(), &prior).unwrap();

        // All variables are linear in [x0; w0; v0; w1; v1; w2; v2].
        let size = 3 + 3 * 5;
        let mut all = DMatrix::zeros(size, size);
        all.view_mut((0, 0), (3, 3)).copy_from(&prior);
        let mut state = DMatrix::zeros(3, size);
        state.view_mut((0, 0), (3, 3)).fill_with_identity();
        let (mut mean, mut seen, mut errors) = (model.rest(), Vec::new(), Vec::new());
        for k in 0..3 {
            let at = 3 + 5 * k;
            all.view_mut((at, at), (3, 3)).copy_from(&noise.process);
            all.view_mut((at + 3, at + 3), (2, 2)).copy_from(&noise.sensor);
            all.view_mut((at, at + 3), (3, 2)).copy_from(&noise.cross);
            all.view_mut((at + 3, at), (2, 3)).copy_from(&noise.cross.transpose());
            let mut output = &model.c * &state;
            output.view_mut((0, at + 3), (2, 2)).fill_with_identity();
            for i in (0..2).filter(|&i| !y[(k, i)].is_nan()) {
                seen.push(output.row(i).into_owned());
                errors.push(y[(k, i)] - (model.c.row(i) * &mean)[0]);
            }
            mean = &model.a * mean + &model.b * u[(k, 0)];
            state = &model.a * state;
            state.view_mut((0, at), (3, 3)).fill_with_identity();
        }
        let seen = DMatrix::from_rows(&seen);
        let inverse = (&seen * &all * seen.transpose()).try_inverse().unwrap();
        let gain = &state * &all * seen.transpose() * inverse;
        let expected = mean + &gain * DVector::from_vec(errors);
        let spread = &state * &all * state.transpose() - gain * seen * &all * state.transpose();
        assert_relative_eq!(run.final_state, expected, epsilon = 1e-12);
        assert_relative_eq!(run.final_covariance, spread, epsilon = 1e-12);
        assert!(run.innovations[(1, 0)].is_nan() && run.innovation_std[(1, 0)] > 0.0);
    }

    #[test]
    fn it_settles_to_the_steady_state_predictor() {
        let mut model = two_modes();
        let noise = joint_noise(7, 4, 2);
        let steady = steady_state_gain(&model, &noise).unwrap();
        model.predictor_gain = Some(steady.gain.clone());
        let (u, y) = (record(1, 200, 2), record(2, 200, 2));
        let start = &steady.covariance;
        let run = kalman_filter(&model, &noise, u.view(), y.view(), &model.rest(), start).unwrap();
        let fixed = one_step_prediction(&model, u.view(), y.view(), &model.rest()).unwrap();
        for (a, b) in run.innovations.iter().zip(&fixed.innovations) {
            assert_relative_eq!(a, b, epsilon = 1e-9);
        }
        assert_relative_eq!(run.final_covariance, *start, epsilon = 1e-9);
    }

    #[test]
    fn perfect_sensors_and_a_known_state_leave_nothing_to_correct() {
        let model = two_modes();
        let none = NoiseCovariances::independent(DMatrix::zeros(4, 4), DMatrix::zeros(2, 2));
        let (u, y) = (record(1, 20, 2), record(2, 20, 2));
        let zero = DMatrix::zeros(4, 4);
        let run = kalman_filter(&model, &none, u.view(), y.view(), &model.rest(), &zero).unwrap();
        assert_eq!(run.final_covariance, zero);
        assert!(run.innovation_std.iter().all(|&s| s == 0.0));
    }

    #[test]
    fn what_is_no_covariance_is_refused() {
        let model = two_modes();
        let mut noise = joint_noise(7, 4, 2);
        noise.cross *= 100.0;
        assert!(matches!(noise.check(&model), Err(ModelError::NotCovariance { .. })));
        let noise = NoiseCovariances::independent(DMatrix::zeros(3, 3), DMatrix::zeros(2, 2));
        assert!(matches!(noise.check(&model), Err(ModelError::Shape { .. })));
    }
}
