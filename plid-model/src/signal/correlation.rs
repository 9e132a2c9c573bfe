use statrs::distribution::{ChiSquared, ContinuousCDF, Normal};

use super::error::SignalError;

/// A correlation function over lags, with its confidence bounds under the null hypothesis of no correlation.
#[derive(Debug, Clone, PartialEq)]
pub struct Correlation {
    /// Lags in samples.
    pub lags: Vec<i64>,
    /// Normalised correlation at each lag.
    pub value: Vec<f64>,
    /// Half-width of the two-sided bound at each lag.
    pub bound: Vec<f64>,
    /// The test over all lags together.
    pub test: CorrelationTest,
}

/// The result of a chi-squared test on a correlation function.
#[derive(Debug, Clone, PartialEq)]
pub struct CorrelationTest {
    /// The test statistic, which has a chi-squared distribution under the null hypothesis.
    pub statistic: f64,
    /// Degrees of freedom of that distribution.
    pub degrees_of_freedom: usize,
    /// Probability of a statistic at least as large under the null hypothesis.
    pub p_value: f64,
    /// Lags at which the value exceeds its bound. Under the null hypothesis, a fraction 1 - confidence of all lags is
    /// expected.
    pub outside: Vec<i64>,
    /// Confidence level of the bounds and of the test, such as 0.99.
    pub confidence: f64,
    /// Whether the null hypothesis is not rejected at this level: p_value >= 1 - confidence.
    pub passes: bool,
}

impl CorrelationTest {
    pub(super) fn new(statistic: f64, degrees_of_freedom: usize, confidence: f64, outside: Vec<i64>) -> Self {
        // The callers guarantee a positive number of degrees of freedom, for which the distribution is always valid.
        let p_value = ChiSquared::new(degrees_of_freedom as f64).map_or(f64::NAN, |chi| chi.sf(statistic));
        Self { statistic, degrees_of_freedom, p_value, outside, confidence, passes: p_value >= 1.0 - confidence }
    }
}

/// Returns the two-sided quantile of the standard normal distribution.
pub(super) fn two_sided_quantile(confidence: f64) -> Result<f64, SignalError> {
    if !(confidence > 0.0 && confidence < 1.0) {
        return Err(SignalError::Setting { name: "confidence", value: confidence, allowed: "between 0 and 1" });
    }
    Ok(Normal::standard().inverse_cdf(0.5 + 0.5 * confidence))
}

pub(super) fn lags_outside(lags: &[i64], value: &[f64], bound: &[f64]) -> Vec<i64> {
    lags.iter().zip(value.iter().zip(bound)).filter(|(_, (v, b))| v.abs() > **b).map(|(lag, _)| *lag).collect()
}

/// Returns the series with its mean removed and its gaps filled with zeros, and the number of samples present. The
/// zeros remove a gap from every sum of products.
pub(super) fn centred(series: impl Iterator<Item = f64> + Clone) -> (Vec<f64>, usize) {
    let present = series.clone().filter(|x| !x.is_nan()).count();
    let mean = series.clone().filter(|x| !x.is_nan()).sum::<f64>() / present as f64;
    (series.map(|x| if x.is_nan() { 0.0 } else { x - mean }).collect(), present)
}
