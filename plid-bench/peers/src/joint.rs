//! The joint filter in the form that a textbook's extended Kalman filter requires: f(s), its Jacobian F, and the
//! covariance of the process noise.

use crate::workload::{CHANNELS, Case};

/// f, F and Qbar of the joint EKF about s+ (plid's `JointEkf` with noises that are independent of each other).
#[derive(Clone, Debug)]
pub struct Joint {
    n: usize,
    rows: Vec<usize>,
    shift: Vec<Option<usize>>,
    actuator: Vec<f64>,
    state: Vec<f64>,
}

impl Joint {
    /// For the shapes and the noise of `case`.
    pub fn new(case: &Case) -> Self {
        Self {
            n: case.states,
            rows: case.rows.clone(),
            shift: case.shift.clone(),
            actuator: case.actuator.clone(),
            state: case.state.clone(),
        }
    }

    /// phi = [C x; u].
    fn regressor(&self, s: &[f64], u: &[f64; CHANNELS]) -> [f64; 2 * CHANNELS] {
        std::array::from_fn(|k| if k < CHANNELS { s[self.rows[k]] } else { u[k - CHANNELS] })
    }

    /// s <- f(s, u): x <- J x + sum_k phi_k theta_k.
    pub fn advance(&self, s: &mut [f64], u: &[f64; CHANNELS]) {
        let n = self.n;
        let phi = self.regressor(s, u);
        for i in (0..n).rev() {
            let shifted = self.shift[i].map_or(0.0, |from| s[from]);
            s[i] = shifted + phi.iter().enumerate().map(|(k, w)| w * s[(1 + k) * n + i]).sum::<f64>();
        }
    }

    /// Calls `set(row, column, value)` for each entry of F that is not always 0, once or, for the columns of A, the
    /// last time counts: F = [J + sum_i a_i e_{c_i}^T, phi (x) I; 0, I].
    pub fn jacobian(&self, s: &[f64], u: &[f64; CHANNELS], mut set: impl FnMut(usize, usize, f64)) {
        let n = self.n;
        let phi = self.regressor(s, u);
        for i in 0..n {
            if let Some(from) = self.shift[i] {
                set(i, from, 1.0);
            }
            for (k, &row) in self.rows.iter().enumerate() {
                let shifted = if self.shift[i] == Some(row) { 1.0 } else { 0.0 };
                set(i, row, shifted + s[(1 + k) * n + i]);
            }
            for (k, &w) in phi.iter().enumerate() {
                set(i, (1 + k) * n + i, w);
            }
        }
        for i in n..(1 + phi.len()) * n {
            set(i, i, 1.0);
        }
    }

    /// Calls `set(row, column, value)` for each entry of Qbar = Sigma + B Q B^T, the n x n block of the process noise
    /// that is not 0.
    pub fn process_noise(&self, s: &[f64], mut set: impl FnMut(usize, usize, f64)) {
        let n = self.n;
        let b = |j: usize| &s[(1 + CHANNELS + j) * n..(2 + CHANNELS + j) * n];
        for c in 0..n {
            for r in 0..n {
                let driven: f64 = self.actuator.iter().enumerate().map(|(j, q)| q * b(j)[r] * b(j)[c]).sum();
                set(r, c, driven + if r == c { self.state[c] } else { 0.0 });
            }
        }
    }
}

/// P <- (P + P^T) / 2
pub fn make_symmetric(p: &mut [f64], size: usize) {
    for i in 0..size {
        for j in 0..i {
            let mean = 0.5 * (p[i * size + j] + p[j * size + i]);
            (p[i * size + j], p[j * size + i]) = (mean, mean);
        }
    }
}
