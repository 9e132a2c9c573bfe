//! Exact Bayes for the scalar plant x+ = a x + b u + xi, z = x + w with known noise variances.
//!
//! Given a, the plant is linear in (x, b), so a Kalman filter with two states integrates b exactly, and only a needs
//! a grid. The grid is narrowed to the range that carries the weight, because at a signal-to-noise ratio of 300 the
//! posterior is a thousandth of the prior's width.

/// The scalar plant's prior: a ~ N truncated to |a| < `largest_a`, b ~ N, x0 ~ N(0, `state_variance`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScalarPrior {
    /// Mean and variance of a before the truncation.
    pub a: (f64, f64),
    /// Mean and variance of b.
    pub b: (f64, f64),
    /// Bound of |a|.
    pub largest_a: f64,
    /// Variance of the first state.
    pub state_variance: f64,
}

impl Default for ScalarPrior {
    fn default() -> Self {
        Self { a: (0.3, 0.09), b: (1.0, 0.25), largest_a: 0.98, state_variance: 1.0 }
    }
}

impl ScalarPrior {
    /// Draws a and b from the prior; `normal` returns independent standard normal numbers.
    pub fn draw(&self, mut normal: impl FnMut() -> f64) -> (f64, f64) {
        let a = loop {
            let a = self.a.0 + self.a.1.sqrt() * normal();
            if a.abs() < self.largest_a {
                break a;
            }
        };
        (a, self.b.0 + self.b.1.sqrt() * normal())
    }
}

/// A record of the scalar plant, with the noise variances that the estimator assumes.
#[derive(Clone, Copy, Debug)]
pub struct ScalarRecord<'a> {
    /// Outputs.
    pub z: &'a [f64],
    /// Inputs.
    pub u: &'a [f64],
    /// Variance R of the sensor noise.
    pub sensor: f64,
    /// Variance Sigma of the state noise.
    pub state: f64,
}

/// Mean and covariance of (a, b) given a record.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Posterior {
    /// Mean of a, mean of b.
    pub mean: [f64; 2],
    /// Variance of a, covariance, variance of b.
    pub covariance: [f64; 3],
}

/// The logarithm of the joint density of the record and a (up to a constant), and the mean and variance of b, for one
/// a.
#[derive(Clone, Copy, Debug)]
struct Given {
    a: f64,
    log_weight: f64,
    b: (f64, f64),
}

/// A weight is negligible if its logarithm is less than the largest by more than this.
const NEGLIGIBLE: f64 = 40.0;

fn given(record: &ScalarRecord<'_>, prior: &ScalarPrior, a: f64) -> Given {
    let mut log_weight = -(a - prior.a.0).powi(2) / (2.0 * prior.a.1);
    let (mut x, mut b) = (0.0, prior.b.0);
    let (mut xx, mut xb, mut bb) = (prior.state_variance, 0.0, prior.b.1);
    for (&z, &u) in record.z.iter().zip(record.u) {
        let (e, s) = (z - x, xx + record.sensor);
        log_weight -= 0.5 * (e * e / s + s.ln());
        let (kx, kb) = (xx / s, xb / s);
        (x, b) = (x + kx * e, b + kb * e);
        (xx, xb, bb) = (xx - kx * xx, xb - kb * xx, bb - kb * xb);
        x = a * x + b * u;
        (xx, xb) = (a * a * xx + 2.0 * a * u * xb + u * u * bb + record.state, a * xb + u * bb);
    }
    Given { a, log_weight, b: (b, bb) }
}

/// Evaluates `points` values of a at the midpoints of equal parts of (from, to).
fn grid(record: &ScalarRecord<'_>, prior: &ScalarPrior, (from, to): (f64, f64), points: usize) -> Vec<Given> {
    let part = (to - from) / points as f64;
    (0..points).map(|i| given(record, prior, from + (i as f64 + 0.5) * part)).collect()
}

/// Returns the posterior of (a, b) from grids of `points` values of a. The grid is narrowed until at least a third of
/// it carries weight.
pub fn exact_bayes(record: &ScalarRecord<'_>, prior: &ScalarPrior, points: usize) -> Posterior {
    let bound = prior.largest_a;
    let mut range = (-bound, bound);
    loop {
        let grid = grid(record, prior, range, points);
        let largest = grid.iter().map(|g| g.log_weight).fold(f64::NEG_INFINITY, f64::max);
        let heavy = |g: &Given| g.log_weight > largest - NEGLIGIBLE;
        let part = (range.1 - range.0) / points as f64;
        let first = grid.iter().position(heavy).unwrap_or(0);
        let last = grid.iter().rposition(heavy).unwrap_or(points - 1);
        if 3 * (last - first + 1) >= points {
            return moments(&grid, largest);
        }
        // A neighbour whose weight seems negligible may have weight between the points.
        range = ((grid[first].a - 1.5 * part).max(-bound), (grid[last].a + 1.5 * part).min(bound));
    }
}

fn moments(grid: &[Given], largest: f64) -> Posterior {
    let weight = |g: &Given| (g.log_weight - largest).exp();
    let total: f64 = grid.iter().map(weight).sum();
    let average = |f: &dyn Fn(&Given) -> f64| grid.iter().map(|g| weight(g) * f(g)).sum::<f64>() / total;
    let mean = [average(&|g| g.a), average(&|g| g.b.0)];
    Posterior {
        mean,
        covariance: [
            average(&|g| (g.a - mean[0]).powi(2)),
            average(&|g| (g.a - mean[0]) * (g.b.0 - mean[1])),
            average(&|g| g.b.1 + (g.b.0 - mean[1]).powi(2)),
        ],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const U: [f64; 12] = [1.0, -1.0, -1.0, 1.0, 1.0, 1.0, -1.0, 1.0, -1.0, -1.0, 1.0, -1.0];

    /// With a = 0, x0 = 0 and z_{k+1} = b u_k + xi_k + w_{k+1}, b is the coefficient of a linear regression with
    /// noise of variance R + Sigma.
    #[test]
    fn b_given_a_known_a_is_a_linear_regression() {
        let prior = ScalarPrior { state_variance: 0.0, ..ScalarPrior::default() };
        let z: Vec<f64> = (0..12).map(|k| (1.7 * k as f64).sin()).collect();
        let record = ScalarRecord { z: &z, u: &U, sensor: 0.3, state: 0.2 };
        let found = given(&record, &prior, 0.0);
        let (mut information, mut weighted) = (1.0 / prior.b.1, prior.b.0 / prior.b.1);
        for k in 0..11 {
            information += U[k] * U[k] / 0.5;
            weighted += U[k] * z[k + 1] / 0.5;
        }
        assert!((found.b.0 - weighted / information).abs() < 1e-13);
        assert!((found.b.1 - 1.0 / information).abs() < 1e-13);
    }

    /// Without sensor noise and with x0 = 0 known, a and b are the coefficients of a linear regression of z_{k+1} on
    /// z_k and u_k.
    #[test]
    fn without_sensor_noise_it_is_a_linear_regression() {
        let wide = ScalarPrior { largest_a: 4.0, state_variance: 0.0, ..ScalarPrior::default() };
        let z: Vec<f64> = (0..12).map(|k| if k == 0 { 0.0 } else { (1.3 * k as f64).sin() }).collect();
        for state in [0.5, 1e-3] {
            let record = ScalarRecord { z: &z, u: &U, sensor: 1e-12, state };
            let found = exact_bayes(&record, &wide, 200);
            let mut normal = [1.0 / wide.a.1, 0.0, 1.0 / wide.b.1];
            let mut right = [wide.a.0 / wide.a.1, wide.b.0 / wide.b.1];
            for k in 0..11 {
                normal[0] += z[k] * z[k] / state;
                normal[1] += z[k] * U[k] / state;
                normal[2] += U[k] * U[k] / state;
                right[0] += z[k] * z[k + 1] / state;
                right[1] += U[k] * z[k + 1] / state;
            }
            let determinant = normal[0] * normal[2] - normal[1] * normal[1];
            let mean = [
                (normal[2] * right[0] - normal[1] * right[1]) / determinant,
                (normal[0] * right[1] - normal[1] * right[0]) / determinant,
            ];
            let covariance = [normal[2], -normal[1], normal[0]].map(|x| x / determinant);
            for (f, e) in found.mean.iter().chain(&found.covariance).zip(mean.iter().chain(&covariance)) {
                assert!(
                    (f - e).abs() < 1e-6 * (1e-3 + e.abs()),
                    "Sigma = {state}: {found:?} for {mean:?}, {covariance:?}"
                );
            }
        }
    }

    #[test]
    fn a_narrow_posterior_does_not_depend_on_the_grid() {
        let (a, b) = (0.71, 0.8);
        let mut x = 0.4;
        let mut z = Vec::new();
        for (k, &u) in U.iter().enumerate() {
            z.push(x + 1e-3 * (2.3 * k as f64).cos());
            x = a * x + b * u;
        }
        let record = ScalarRecord { z: &z, u: &U, sensor: 1e-6, state: 1e-7 };
        let [coarse, fine] = [60, 1000].map(|points| exact_bayes(&record, &ScalarPrior::default(), points));
        assert!((coarse.mean[0] - a).abs() < 5e-3 && coarse.covariance[0].sqrt() < 1e-2);
        for (c, f) in coarse.mean.iter().chain(&coarse.covariance).zip(fine.mean.iter().chain(&fine.covariance)) {
            assert!((c - f).abs() < 1e-6 * (1e-6 + f.abs()), "{coarse:?}, {fine:?}");
        }
    }
}
