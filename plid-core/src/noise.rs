//! The noise model of Eq. 5: the covariances and cross-covariances of sensor noise w, actuator noise v and state
//! noise xi.

use crate::kernels::{BadPivot, axpy, pivoted_cholesky, semidefinite_ldl};
use crate::{Dense, Matrix, Scalar};

/// The second moments of eta = [w; v; xi] (Eq. 5).
#[derive(Clone, Debug, PartialEq)]
pub struct NoiseModel {
    /// R = E[w w^T], p x p, in the outputs' unit squared.
    pub sensor: Dense<f64>,
    /// Q = E[v v^T], m x m, in the inputs' unit squared.
    pub actuator: Dense<f64>,
    /// Sigma = E[xi xi^T], n x n; in the canonical form a state has the unit of its output.
    pub state: Dense<f64>,
    /// S^{vw} = E[v w^T], m x p.
    pub actuator_sensor: Dense<f64>,
    /// S^{w xi} = E[w xi^T], p x n.
    pub sensor_state: Dense<f64>,
    /// S^{v xi} = E[v xi^T], m x n.
    pub actuator_state: Dense<f64>,
}

/// The reasons why a noise model is rejected.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NoiseError {
    /// A matrix has the wrong shape.
    #[error("{name} is {rows} x {columns}; it must be {expected_rows} x {expected_columns}")]
    Shape {
        /// The name of the matrix.
        name: &'static str,
        /// The number of its rows.
        rows: usize,
        /// The number of its columns.
        columns: usize,
        /// The number of rows that the plant requires.
        expected_rows: usize,
        /// The number of columns that the plant requires.
        expected_columns: usize,
    },
    /// An entry is NaN or infinite.
    #[error("{name} has an entry that is not finite at row {row}, column {column} (from 1)")]
    NotFinite {
        /// The name of the matrix.
        name: &'static str,
        /// Row, from 1.
        row: usize,
        /// Column, from 1.
        column: usize,
    },
    /// A covariance is not symmetric.
    #[error("{name} is not symmetric at row {row}, column {column} (from 1)")]
    NotSymmetric {
        /// The name of the matrix.
        name: &'static str,
        /// Row, from 1.
        row: usize,
        /// Column, from 1.
        column: usize,
    },
    /// The joint covariance of [w; v; xi] has a negative eigenvalue.
    #[error(
        "the joint covariance of sensor, actuator and state noise is not positive semidefinite (pivot {value:.3e} at \
         {place})"
    )]
    Indefinite {
        /// The channel or state at fault.
        place: String,
        /// The pivot.
        value: f64,
    },
}

impl NoiseModel {
    /// Returns independent white noise with variances `sensor` (p), `actuator` (m) and `state` (n).
    pub fn diagonal(sensor: &[f64], actuator: &[f64], state: &[f64]) -> Self {
        let (p, m, n) = (sensor.len(), actuator.len(), state.len());
        Self {
            sensor: Dense::from_diagonal(sensor),
            actuator: Dense::from_diagonal(actuator),
            state: Dense::from_diagonal(state),
            actuator_sensor: Dense::zeros(m, p),
            sensor_state: Dense::zeros(p, n),
            actuator_state: Dense::zeros(m, n),
        }
    }

    /// Returns the paper's numbers 0.005, 0.005 and 0.010, interpreted as covariances, as the paper uses them.
    pub fn paper_literal(p: usize, m: usize, n: usize) -> Self {
        Self::diagonal(&vec![0.005; p], &vec![0.005; m], &vec![0.010; n])
    }

    /// Returns the paper's numbers interpreted as volts RMS, which they are, so that their squares are the
    /// covariances.
    pub fn paper_squared(p: usize, m: usize, n: usize) -> Self {
        let square = |x: f64| x * x;
        Self::diagonal(&vec![square(0.005); p], &vec![square(0.005); m], &vec![square(0.010); n])
    }

    /// Checks that the shapes agree with p outputs, m inputs and n states, that every entry is finite, that R, Q and
    /// Sigma are symmetric, and that the six matrices together form a positive semidefinite covariance.
    ///
    /// # Errors
    /// Returns a [`NoiseError`] that names the matrix and the entry, or the channel or state.
    pub fn check(&self, p: usize, m: usize, n: usize) -> Result<(), NoiseError> {
        self.check_within(p, m, n, &mut CheckScratch::new(p + m + n))
    }

    fn check_within(&self, p: usize, m: usize, n: usize, scratch: &mut CheckScratch) -> Result<(), NoiseError> {
        let all = [
            ("R (sensor)", &self.sensor, p, p, true),
            ("Q (actuator)", &self.actuator, m, m, true),
            ("Sigma (state)", &self.state, n, n, true),
            ("S^{vw} (actuator-sensor)", &self.actuator_sensor, m, p, false),
            ("S^{w xi} (sensor-state)", &self.sensor_state, p, n, false),
            ("S^{v xi} (actuator-state)", &self.actuator_state, m, n, false),
        ];
        for (name, matrix, expected_rows, expected_columns, symmetric) in all {
            let (rows, columns) = (matrix.rows(), matrix.columns());
            if (rows, columns) != (expected_rows, expected_columns) {
                return Err(NoiseError::Shape { name, rows, columns, expected_rows, expected_columns });
            }
            for j in 0..columns {
                for i in 0..rows {
                    let (row, column) = (i + 1, j + 1);
                    if !matrix.at(i, j).is_finite() {
                        return Err(NoiseError::NotFinite { name, row, column });
                    }
                    if symmetric && i > j {
                        let scale = (matrix.at(i, i) * matrix.at(j, j)).abs().sqrt();
                        if (matrix.at(i, j) - matrix.at(j, i)).abs() > 1e-12 * scale {
                            return Err(NoiseError::NotSymmetric { name, row, column });
                        }
                    }
                }
            }
        }
        self.check_semidefinite(p, m, n, scratch)
    }

    /// Checks the correlation matrix, so that variances in different units, such as volts and newtons, do not mask
    /// each other.
    fn check_semidefinite(&self, p: usize, m: usize, n: usize, scratch: &mut CheckScratch) -> Result<(), NoiseError> {
        let size = p + m + n;
        let CheckScratch { deviation, scale, correlation, factor } = scratch;
        let entry = |i: usize, j: usize| -> f64 {
            let kind = |i: usize| {
                if i < p {
                    (0, i)
                } else if i < p + m {
                    (1, i - p)
                } else {
                    (2, i - p - m)
                }
            };
            match (kind(i), kind(j)) {
                ((0, i), (0, j)) => self.sensor.at(i, j),
                ((1, i), (1, j)) => self.actuator.at(i, j),
                ((2, i), (2, j)) => self.state.at(i, j),
                ((1, i), (0, j)) | ((0, j), (1, i)) => self.actuator_sensor.at(i, j),
                ((0, i), (2, j)) | ((2, j), (0, i)) => self.sensor_state.at(i, j),
                ((1, i), (2, j)) | ((2, j), (1, i)) => self.actuator_state.at(i, j),
                _ => unreachable!("three kinds of noise"),
            }
        };
        let place = |i: usize| {
            if i < p {
                format!("output {}", i + 1)
            } else if i < p + m {
                format!("input {}", i - p + 1)
            } else {
                format!("state {}", i - p - m + 1)
            }
        };
        for i in 0..size {
            deviation[i] = entry(i, i).max(0.0).sqrt();
        }
        let correlate = |i: usize, j: usize| {
            if deviation[i] > 0.0 && deviation[j] > 0.0 { entry(i, j) / (deviation[i] * deviation[j]) } else { 0.0 }
        };
        for i in 0..size {
            let covaries = (0..size).any(|j| j != i && entry(i, j) != 0.0);
            if entry(i, i) < 0.0 || (entry(i, i) == 0.0 && covaries) {
                return Err(NoiseError::Indefinite { place: place(i), value: entry(i, i) });
            }
        }
        for j in 0..size {
            for i in 0..size {
                *correlation.at_mut(i, j) = correlate(i, j);
            }
        }
        pivoted_cholesky(correlation.view_mut(), factor.view_mut(), scale, 1e-10, 1e-10)
            .map_err(|BadPivot { index, value }| NoiseError::Indefinite { place: place(index), value })?;
        // Where a pivot is zero, the entries off the diagonal must be zero too: [0 1; 1 0] has no negative pivot but
        // is indefinite.
        for i in 0..size {
            for j in 0..i {
                let product: f64 = (0..size).map(|k| factor.at(i, k) * factor.at(j, k)).sum();
                let target = correlate(i, j);
                if (product - target).abs() > 1e-9 {
                    return Err(NoiseError::Indefinite { place: place(i), value: target - product });
                }
            }
        }
        Ok(())
    }
}

/// Scratch space for the check that a noise model is positive semidefinite.
#[derive(Clone, Debug)]
struct CheckScratch {
    deviation: Vec<f64>,
    scale: Vec<f64>,
    correlation: Dense<f64>,
    factor: Dense<f64>,
}

impl CheckScratch {
    fn new(size: usize) -> Self {
        Self {
            deviation: vec![0.0; size],
            scale: vec![0.0; size],
            correlation: Dense::zeros(size, size),
            factor: Dense::zeros(size, size),
        }
    }
}

/// The part of the noise model that a step uses: the moments of v and xi given w, for the available outputs.
#[derive(Clone, Debug)]
pub struct NoiseTerms<S> {
    available: Vec<usize>,
    sensor: Dense<S>,
    actuator: Dense<S>,
    state: Dense<S>,
    actuator_sensor: Dense<S>,
    sensor_state: Dense<S>,
    actuator_state: Dense<S>,
    /// The unit lower triangular T of R = T D T^T, for the available outputs.
    unit: Dense<S>,
    pivots: Vec<S>,
    l: Dense<S>,
    m: Dense<S>,
    actuator_given: Dense<S>,
    state_given: Dense<S>,
    actuator_state_given: Dense<S>,
    solve: Vec<S>,
    scratch: CheckScratch,
}

impl<S: Scalar> NoiseTerms<S> {
    /// Computes the terms of a checked noise model, with all outputs available.
    pub fn new(noise: &NoiseModel) -> Self {
        let (p, m, n) = (noise.sensor.rows(), noise.actuator.rows(), noise.state.rows());
        let mut terms = Self {
            available: (0..p).collect(),
            sensor: noise.sensor.cast(),
            actuator: noise.actuator.cast(),
            state: noise.state.cast(),
            actuator_sensor: noise.actuator_sensor.cast(),
            sensor_state: noise.sensor_state.cast(),
            actuator_state: noise.actuator_state.cast(),
            unit: Dense::zeros(p, p),
            pivots: vec![S::zero(); p],
            l: Dense::zeros(m, p),
            m: Dense::zeros(n, p),
            actuator_given: Dense::zeros(m, m),
            state_given: Dense::zeros(n, n),
            actuator_state_given: Dense::zeros(m, n),
            solve: vec![S::zero(); p],
            scratch: CheckScratch::new(p + m + n),
        };
        terms.condition();
        terms
    }

    /// Checks another noise model and adopts it, without allocating. After an error, the previous one is kept.
    ///
    /// # Errors
    /// Returns a [`NoiseError`] that names the matrix and the entry, or the channel or state.
    pub fn set(&mut self, noise: &NoiseModel) -> Result<(), NoiseError> {
        let (p, m, n) = (self.sensor.rows(), self.actuator.rows(), self.state.rows());
        noise.check_within(p, m, n, &mut self.scratch)?;
        let copy = |from: &Dense<f64>, to: &mut Dense<S>| {
            for j in 0..from.columns() {
                for (to, &from) in to.column_mut(j).iter_mut().zip(from.column(j)) {
                    *to = S::from_f64(from);
                }
            }
        };
        copy(&noise.sensor, &mut self.sensor);
        copy(&noise.actuator, &mut self.actuator);
        copy(&noise.state, &mut self.state);
        copy(&noise.actuator_sensor, &mut self.actuator_sensor);
        copy(&noise.sensor_state, &mut self.sensor_state);
        copy(&noise.actuator_state, &mut self.actuator_state);
        self.condition();
        Ok(())
    }

    /// Sets the available outputs. The w_i of the other outputs are left out of R and of the cross-covariances.
    pub fn set_available(&mut self, available: impl Iterator<Item = bool>) {
        // The terms are recomputed only if the set has changed, so a record without gaps costs no further work.
        let mut position = 0;
        let mut changed = false;
        for (i, there) in available.enumerate() {
            if there {
                if self.available.get(position) != Some(&i) {
                    changed = true;
                    self.available.truncate(position);
                    self.available.push(i);
                }
                position += 1;
            }
        }
        if changed || position != self.available.len() {
            self.available.truncate(position);
            self.condition();
        }
    }

    /// Computes L = S^{vw} R^-1, M = (S^{w xi})^T R^-1, Q' = Q - L (S^{vw})^T, Sigma' = Sigma - M S^{w xi} and
    /// S' = S^{v xi} - L S^{w xi}. If R is singular, any generalised inverse gives the same terms, because the
    /// cross-covariances and the residual z - C x+ lie in the range of R.
    fn condition(&mut self) {
        let (m, n) = (self.actuator.rows(), self.state.rows());
        let count = self.available.len();
        for (j, &channel_j) in self.available.iter().enumerate() {
            for (i, &channel_i) in self.available.iter().enumerate() {
                *self.unit.at_mut(i, j) = self.sensor.at(channel_i, channel_j);
            }
        }
        // The model has been checked, so a negative pivot is zero within rounding. The factorisation fails only if R
        // is outside the range of the scalar; NaN then stops the measurement update.
        let zero = 64.0 * count as f64 * S::EPSILON;
        self.pivots.fill(S::from_f64(f64::NAN));
        let mut unit = self.unit.view_mut();
        let _ = semidefinite_ldl(unit.block_mut(0, 0, count, count), &mut self.pivots, zero, f64::INFINITY);
        for row in 0..m {
            for (i, &channel) in self.available.iter().enumerate() {
                self.solve[i] = self.actuator_sensor.at(row, channel);
            }
            self.solve_sensor(count);
            for i in 0..count {
                *self.l.at_mut(row, i) = self.solve[i];
            }
        }
        for row in 0..n {
            for (i, &channel) in self.available.iter().enumerate() {
                self.solve[i] = self.sensor_state.at(channel, row);
            }
            self.solve_sensor(count);
            for i in 0..count {
                *self.m.at_mut(row, i) = self.solve[i];
            }
        }
        for b in 0..m {
            for a in 0..m {
                let known =
                    self.available.iter().enumerate().fold(S::zero(), |sum, (i, &channel)| {
                        sum + self.l.at(a, i) * self.actuator_sensor.at(b, channel)
                    });
                *self.actuator_given.at_mut(a, b) = self.actuator.at(a, b) - known;
            }
        }
        for b in 0..n {
            self.state_given.column_mut(b).copy_from_slice(self.state.column(b));
            for (i, &channel) in self.available.iter().enumerate() {
                axpy(-self.sensor_state.at(channel, b), self.m.column(i), self.state_given.column_mut(b));
            }
            for a in 0..m {
                let known = self
                    .available
                    .iter()
                    .enumerate()
                    .fold(S::zero(), |sum, (i, &channel)| sum + self.l.at(a, i) * self.sensor_state.at(channel, b));
                *self.actuator_state_given.at_mut(a, b) = self.actuator_state.at(a, b) - known;
            }
        }
    }

    /// Computes `solve` <- R^- `solve` with a generalised inverse R^-.
    fn solve_sensor(&mut self, count: usize) {
        let x = &mut self.solve[..count];
        for j in 0..count {
            let xj = x[j];
            axpy(-xj, &self.unit.column(j)[j + 1..count], &mut x[j + 1..]);
        }
        for i in 0..count {
            x[i] = if self.pivots[i] > S::zero() { x[i] / self.pivots[i] } else { S::zero() };
        }
        for i in (0..count).rev() {
            for j in i + 1..count {
                let xj = x[j];
                x[i] -= self.unit.at(j, i) * xj;
            }
        }
    }

    /// Returns the available outputs in ascending order. The rows and columns of R, L and M below are in this order.
    pub fn available(&self) -> &[usize] {
        &self.available
    }

    /// Returns entry (i, j) of R, with i and j counted among the available outputs.
    pub fn sensor(&self, i: usize, j: usize) -> S {
        self.sensor.at(self.available[i], self.available[j])
    }

    /// Returns entry (i, j), i > j, of the unit lower triangular T of R = T D T^T.
    pub fn sensor_unit(&self, i: usize, j: usize) -> S {
        self.unit.at(i, j)
    }

    /// Returns the diagonal of D in R = T D T^T, for the available outputs.
    pub fn sensor_pivots(&self) -> &[S] {
        &self.pivots[..self.available.len()]
    }

    /// Returns Q (m x m).
    pub fn actuator(&self) -> &Dense<S> {
        &self.actuator
    }

    /// Returns S^{vw} (m x p), with the columns numbered by output.
    pub fn actuator_sensor(&self) -> &Dense<S> {
        &self.actuator_sensor
    }

    /// Returns L = S^{vw} R^-1 (m x p), with the columns of the available outputs first.
    pub fn l(&self) -> &Dense<S> {
        &self.l
    }

    /// Returns M = (S^{w xi})^T R^-1 (n x p), with the columns of the available outputs first.
    pub fn m(&self) -> &Dense<S> {
        &self.m
    }

    /// Returns Q' = cov(v | w), m x m.
    pub fn actuator_given(&self) -> &Dense<S> {
        &self.actuator_given
    }

    /// Returns Sigma' = cov(xi | w), n x n.
    pub fn state_given(&self) -> &Dense<S> {
        &self.state_given
    }

    /// Returns S' = cov(v, xi | w), m x n.
    pub fn actuator_state_given(&self) -> &Dense<S> {
        &self.actuator_state_given
    }
}
