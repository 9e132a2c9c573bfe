use nalgebra::DMatrix;

use super::eigen::eigenvalues;
use super::error::ModelError;
use super::kalman::{NoiseCovariances, Seen, symmetric};
use super::state_space::Model;

/// Largest number of doubling steps: 2^50 samples are more than any filter needs to converge.
const STEPS: usize = 50;
/// The doubling ends when a step changes the solution by less than this, relative to the solution.
const SETTLED: f64 = 1e-14;
/// Largest acceptable residual, relative to the solution.
const RESIDUAL: f64 = 1e-6;
/// Regularisation of a covariance that is singular to working precision, relative to a typical variance.
const REGULARISATION: f64 = 1e-12;

/// The steady-state Kalman predictor.
#[derive(Debug, Clone, PartialEq)]
pub struct SteadyState {
    /// Predictor gain K (n x p).
    pub gain: DMatrix<f64>,
    /// Covariance of the predicted state (n x n).
    pub covariance: DMatrix<f64>,
    /// Residual of the Riccati equation relative to the covariance, both as Frobenius norms.
    pub residual: f64,
}

/// Computes the steady-state predictor gain K = (A P C^T + S)(C P C^T + R)^{-1}, where P = A P A^T + Q - K (C P C^T +
/// R) K^T, by the structure-preserving doubling algorithm (Chu, Fan, Lin and Wang 2004).
///
/// A may be unstable. If R is singular to working precision, 1e-12 of the mean variance of the outputs (sensor noise
/// and one sample of process noise) is added to its diagonal. If A is unstable and Q singular, 1e-12 of the mean
/// variance of a state (of process noise, or of sensor noise over |C|^2) is added to the diagonal of Q, because the
/// doubling would otherwise stay at its zero initial value. The residual and the stability are evaluated for the
/// original equation.
///
/// # Errors
/// Returns [`ModelError::Shape`], [`ModelError::NotCovariance`], or [`ModelError::Riccati`] if there is no stabilising
/// solution.
pub fn steady_state_gain(model: &Model, noise: &NoiseCovariances) -> Result<SteadyState, ModelError> {
    noise.check(model)?;
    let (n, p) = (model.n(), model.p());
    let unstable = spectral_radius(&model.a)? >= 1.0;
    let seen_process = (&model.c * &noise.process * model.c.transpose()).trace() / p as f64;
    let sensor_scale = noise.sensor.trace() / p as f64 + seen_process;
    let sensor = regularised(&noise.sensor, sensor_scale);
    let inverse = sensor.clone().cholesky().map(|factor| factor.inverse()).unwrap_or_else(|| DMatrix::zeros(p, p));
    let cross = &noise.cross * &inverse;
    let mut process = symmetric(&(&noise.process - &cross * noise.cross.transpose()));
    if unstable {
        let of_sensor = noise.sensor.trace() / model.c.norm_squared().max(f64::MIN_POSITIVE);
        let scale = (noise.process.trace() / n as f64).max(of_sensor);
        process = regularised(&process, scale);
    }
    let a = (&model.a - cross * &model.c).transpose();
    let g = symmetric(&(model.c.transpose() * inverse * &model.c));
    let (covariance, iterations) = doubled(a, g, process);

    let every: Vec<usize> = (0..p).collect();
    let seen = Seen::of(model, noise, &every);
    let gain = seen.gain(model, &covariance);
    let next = seen.next_covariance(model, noise, &covariance, &gain);
    let size = covariance.norm().max(noise.process.norm());
    let difference = (next - &covariance).norm();
    let residual = if difference == 0.0 { 0.0 } else { difference / size };
    let closed = &model.a - &gain * &model.c;
    let finite = closed.iter().all(|x| x.is_finite());
    let radius = if finite { spectral_radius(&closed)? } else { f64::INFINITY };
    if !(residual <= RESIDUAL && radius < 1.0) {
        return Err(ModelError::Riccati { residual, radius, iterations });
    }
    Ok(SteadyState { gain, covariance, residual })
}

/// Returns the stabilising solution X of X = A^T X (I + G X)^{-1} A + H and the number of steps taken.
fn doubled(mut a: DMatrix<f64>, mut g: DMatrix<f64>, mut h: DMatrix<f64>) -> (DMatrix<f64>, usize) {
    let n = a.nrows();
    for step in 1..=STEPS {
        let middle = (DMatrix::identity(n, n) + &g * &h).lu();
        let (Some(wa), Some(wg)) = (middle.solve(&a), middle.solve(&g)) else {
            return (h, step);
        };
        let change = symmetric(&(a.transpose() * &h * &wa));
        g = symmetric(&(&g + &a * wg * a.transpose()));
        a *= wa;
        h += &change;
        let moves = change.norm() > SETTLED * h.norm();
        if !moves {
            return (h, step);
        }
    }
    (h, STEPS)
}

/// Returns the covariance unchanged if it has a well-conditioned Cholesky factor, and otherwise with a small addition
/// to its diagonal.
fn regularised(covariance: &DMatrix<f64>, scale: f64) -> DMatrix<f64> {
    let size = covariance.nrows();
    let smallest = symmetric(covariance).symmetric_eigenvalues().min();
    if smallest > REGULARISATION * scale {
        return covariance.clone();
    }
    // If both noises are zero, any positive value will do.
    let scale = if scale > 0.0 { scale } else { 1.0 };
    let added = REGULARISATION * scale + (-smallest).max(0.0);
    covariance + DMatrix::identity(size, size) * added
}

fn spectral_radius(a: &DMatrix<f64>) -> Result<f64, ModelError> {
    Ok(eigenvalues(a)?.iter().map(|z| z.norm()).fold(0.0, f64::max))
}

#[cfg(test)]
mod tests {
    use super::super::testing::{canonical, covariance, two_modes};
    use super::*;
    use approx::assert_relative_eq;

    /// Returns A, C and the joint noise covariance from formulas that another program can reproduce.
    fn by_formula(n: usize, p: usize, scale: f64) -> (Model, NoiseCovariances) {
        let one = |i: usize| (i + 1) as f64;
        let a = DMatrix::from_fn(n, n, |i, j| scale / (n as f64).sqrt() * (one(i) * (one(j) + 1.0)).sin());
        let c = DMatrix::from_fn(p, n, |i, j| (one(i) * (one(j) + 2.0)).cos());
        let size = n + p;
        let root = DMatrix::from_fn(size, size, |i, j| (one(i) * (one(j) + 2.0)).cos() / (size as f64).sqrt());
        let all = &root * root.transpose() + DMatrix::identity(size, size) * 0.1;
        let noise = NoiseCovariances {
            process: all.view((0, 0), (n, n)).into_owned(),
            sensor: all.view((n, n), (p, p)).into_owned(),
            cross: all.view((0, n), (n, p)).into_owned(),
        };
        let model = Model::new(1.0, a, DMatrix::zeros(n, 1), c, DMatrix::zeros(p, 1));
        (model.unwrap(), noise)
    }

    /// Reference values from scipy 1.17.1: `P = solve_discrete_are(A.T, C.T, Q, R, s=S)`, `K = (A P C.T + S) inv(C P
    /// C.T + R)`. The four numbers are trace P, the sum of K, K[0,0] and the Frobenius norm of K. The second, fourth
    /// and fifth A are unstable.
    #[test]
    fn it_agrees_with_scipy() {
        let figures = [
            (
                2,
                1,
                0.9,
                [
                    1.533_830_717_578_130_3,
                    -0.095_058_281_304_081_82,
                    -0.167_850_578_996_780_7,
                    0.182_955_009_422_909_82,
                ],
            ),
            (
                5,
                2,
                1.5,
                [5.185_676_388_641_201, -0.757_306_574_129_708_5, -0.535_653_890_820_653_8, 0.958_544_246_505_979_1],
            ),
            (
                12,
                3,
                1.2,
                [17.972_068_476_761_8, -0.296_476_520_342_111_9, -0.304_430_074_521_852_4, 0.784_376_486_752_840_2],
            ),
            (
                30,
                3,
                1.3,
                [86.928_556_327_447_58, -1.093_864_349_024_403_8, -0.254_801_398_593_976_77, 0.800_358_794_808_048],
            ),
            (
                64,
                3,
                1.1,
                [508.360_658_074_476_8, -0.648_991_101_649_843_6, -0.124_433_824_323_009_34, 0.708_881_010_492_632],
            ),
        ];
        for (n, p, scale, [trace, sum, first, norm]) in figures {
            let (model, noise) = by_formula(n, p, scale);
            let found = steady_state_gain(&model, &noise).unwrap();
            assert_relative_eq!(found.covariance.trace(), trace, max_relative = 1e-9);
            assert_relative_eq!(found.gain.sum(), sum, max_relative = 1e-8);
            assert_relative_eq!(found.gain[(0, 0)], first, max_relative = 1e-8);
            assert_relative_eq!(found.gain.norm(), norm, max_relative = 1e-9);
        }
    }

    #[test]
    fn it_is_where_the_recursion_ends() {
        for (n, p, scale) in [(3, 1, 1.4), (8, 2, 1.3), (40, 2, 1.2)] {
            let (model, noise) = by_formula(n, p, scale);
            let every: Vec<usize> = (0..p).collect();
            let seen = Seen::of(&model, &noise, &every);
            let mut covariance = DMatrix::identity(n, n);
            for _ in 0..2000 {
                let gain = seen.gain(&model, &covariance);
                covariance = seen.next_covariance(&model, &noise, &covariance, &gain);
            }
            let found = steady_state_gain(&model, &noise).unwrap();
            let size = covariance.norm();
            assert_relative_eq!(found.covariance, covariance, epsilon = 1e-9 * size);
        }
    }

    fn scalar(a: f64, c: f64, q: f64, r: f64) -> Result<SteadyState, ModelError> {
        let one = |x| DMatrix::from_element(1, 1, x);
        let model = Model::new(1.0, one(a), one(1.0), one(c), one(0.0)).unwrap();
        steady_state_gain(&model, &NoiseCovariances::independent(one(q), one(r)))
    }

    #[test]
    fn scalar_cases_have_closed_forms() {
        // P^2 + (R (1 - a^2) - Q) P - Q R = 0.
        let found = scalar(0.9, 1.0, 0.3, 0.7).unwrap();
        let half = (0.7 * (1.0 - 0.81) - 0.3) / 2.0;
        let closed = -half + f64::sqrt(half * half + 0.21);
        assert_relative_eq!(found.covariance[(0, 0)], closed, max_relative = 1e-12);
        // Unstable without process noise: P = (a^2 - 1) R.
        let found = scalar(2.0, 1.0, 0.0, 1.0).unwrap();
        assert_relative_eq!(found.covariance[(0, 0)], 3.0, max_relative = 1e-9);
        assert_relative_eq!(found.gain[(0, 0)], 1.5, max_relative = 1e-9);
        // Stable without process noise: the covariance tends to zero.
        assert_eq!(scalar(0.9, 1.0, 0.0, 1.0).unwrap().gain[(0, 0)], 0.0);
        // A perfect sensor: P = Q, K = a / c.
        let found = scalar(0.9, 2.0, 0.3, 0.0).unwrap();
        assert_relative_eq!(found.covariance[(0, 0)], 0.3, max_relative = 1e-6);
        assert_relative_eq!(found.gain[(0, 0)], 0.45, max_relative = 1e-6);
    }

    #[test]
    fn what_cannot_be_observed_and_grows_has_no_filter() {
        assert!(matches!(scalar(1.1, 0.0, 1.0, 1.0), Err(ModelError::Riccati { .. })));
        // A random walk without noise has no stabilising solution.
        assert!(matches!(scalar(1.0, 0.0, 0.0, 1.0), Err(ModelError::Riccati { .. })));
    }

    #[test]
    fn lightly_damped_modes_and_small_noise_are_solved() {
        let model = two_modes();
        let (process, sensor) = (covariance(1, 4) * 1e-10, covariance(2, 2) * 1e-4);
        let noise = NoiseCovariances::independent(process, sensor);
        assert!(steady_state_gain(&model, &noise).unwrap().residual < 1e-12);
        let model = canonical(9, &[10, 10, 10], 3);
        let noise = NoiseCovariances::independent(DMatrix::identity(30, 30) * 1e-8, DMatrix::identity(3, 3) * 1e-4);
        assert!(steady_state_gain(&model, &noise).unwrap().residual < 1e-12);
    }
}
