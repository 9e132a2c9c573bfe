//! Figures over runs, each with its Monte Carlo standard error.

use serde::{Deserialize, Serialize};
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// A figure and its Monte Carlo standard error.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Figure {
    /// The figure.
    pub value: f64,
    /// Its standard error. It is infinite for a single run and then has no key in a file.
    #[serde(default = "infinite", skip_serializing_if = "is_infinite")]
    pub error: f64,
}

fn infinite() -> f64 {
    f64::INFINITY
}

fn is_infinite(value: &f64) -> bool {
    value.is_infinite()
}

/// Returns the mean and its standard error, or `None` for an empty list.
pub fn mean(values: &[f64]) -> Option<Figure> {
    let count = values.len() as f64;
    if values.is_empty() {
        return None;
    }
    let value = values.iter().sum::<f64>() / count;
    let error = if values.len() == 1 {
        f64::INFINITY
    } else {
        (values.iter().map(|v| (v - value).powi(2)).sum::<f64>() / (count - 1.0) / count).sqrt()
    };
    Some(Figure { value, error })
}

/// Returns the root of the mean of `squares`. Its relative error is half that of the mean.
pub fn root_mean(squares: &[f64]) -> Option<Figure> {
    let Figure { value, error } = mean(squares)?;
    let root = value.sqrt();
    let error = if error == 0.0 { 0.0 } else { error / (2.0 * root) };
    Some(Figure { value: root, error })
}

/// Returns the root of the ratio of two means of squares over the same runs. The runs are paired, so variations that
/// all methods share in a run cancel in the error.
pub fn paired_root_ratio(squares: &[f64], reference: &[f64]) -> Option<Figure> {
    let (over, under) = (mean(squares)?.value, mean(reference)?.value);
    if !(under > 0.0 && over > 0.0) {
        return None;
    }
    // d ln(ratio) = (x / E x - y / E y) / 2 to first order.
    let differences: Vec<f64> = squares.iter().zip(reference).map(|(x, y)| 0.5 * (x / over - y / under)).collect();
    let value = (over / under).sqrt();
    Some(Figure { value, error: value * mean(&differences)?.error })
}

/// Returns the geometric mean. Free-run errors of runs differ by factors, and a few poor ones would dominate an
/// arithmetic mean.
pub fn geometric_mean(values: &[f64]) -> Option<Figure> {
    let logs: Vec<f64> = values.iter().map(|v| v.ln()).collect();
    let Figure { value, error } = mean(&logs)?;
    Some(Figure { value: value.exp(), error: value.exp() * error })
}

/// Returns the interval that contains the NEES of a consistent filter with probability 0.95. The NEES is the mean
/// over `runs` runs of a chi-square with `dimensions` degrees of freedom, divided by `dimensions`.
pub fn consistent_band(runs: usize, dimensions: usize) -> Option<(f64, f64)> {
    let freedom = (runs * dimensions) as f64;
    let chi = ChiSquared::new(freedom).ok()?;
    Some((chi.inverse_cdf(0.025) / freedom, chi.inverse_cdf(0.975) / freedom))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    #[test]
    fn the_errors_are_those_of_closed_forms() {
        let found = mean(&[1.0, 3.0, 5.0]).unwrap();
        assert!((found.value - 3.0).abs() < 1e-15 && (found.error - (4.0f64 / 3.0).sqrt()).abs() < 1e-15);
        let root = root_mean(&[1.0, 9.0]).unwrap();
        assert!((root.value - 5f64.sqrt()).abs() < 1e-15 && (root.error - 4.0 / (2.0 * 5f64.sqrt())).abs() < 1e-15);
        assert!((geometric_mean(&[1.0, 100.0]).unwrap().value - 10.0).abs() < 1e-12);
        assert_eq!(mean(&[]), None);
    }

    #[test]
    fn a_ratio_of_proportional_runs_has_no_error() {
        let squares = [1.0, 4.0, 2.0, 8.0];
        let quadrupled: Vec<f64> = squares.iter().map(|x| 4.0 * x).collect();
        let found = paired_root_ratio(&quadrupled, &squares).unwrap();
        assert!((found.value - 2.0).abs() < 1e-15 && found.error < 1e-15);
    }

    /// The estimate of a normal mean with known variance is linear and Gaussian, so its NEES over runs lies within
    /// the band 95 times in a hundred.
    #[test]
    fn a_linear_gaussian_case_is_consistent_as_often_as_the_band_says() {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let (runs, trials) = (40, 400);
        let (low, high) = consistent_band(runs, 1).unwrap();
        let inside = (0..trials)
            .filter(|_| {
                let nees: Vec<f64> = (0..runs)
                    .map(|_| {
                        // With the prior N(0, 1) and one measurement with variance 0.5, the posterior variance is
                        // 1/3.
                        let (truth, noise): (f64, f64) =
                            (StandardNormal.sample(&mut rng), StandardNormal.sample(&mut rng));
                        let estimate = (truth + 0.5f64.sqrt() * noise) * 2.0 / 3.0;
                        (estimate - truth).powi(2) * 3.0
                    })
                    .collect();
                (low..=high).contains(&mean(&nees).unwrap().value)
            })
            .count();
        // The number is binomial with 400 trials at 0.95: 380 with a standard deviation of 4.4.
        assert!((363..=395).contains(&inside), "{inside} of {trials}");
    }
}
