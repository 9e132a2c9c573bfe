use ndarray::ArrayView2;

use super::correlation::{Correlation, CorrelationTest, centred, lags_outside, two_sided_quantile};
use super::error::{SignalError, check_record};

/// Settings of [`whiteness`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WhitenessOptions {
    /// Largest lag in samples.
    pub lags: usize,
    /// Number of parameters fitted to these residuals, which reduces the degrees of freedom of the test; 0 on held-out
    /// data.
    pub fitted_parameters: usize,
    /// Confidence level of the bounds and of the test.
    pub confidence: f64,
}

impl Default for WhitenessOptions {
    fn default() -> Self {
        Self { lags: 50, fitted_parameters: 0, confidence: 0.99 }
    }
}

/// Computes the autocorrelation of each column of `residuals` (`samples x p`) with its bounds, and the portmanteau test
/// of Ljung and Box (1978).
///
/// With missing samples each lag is estimated from the pairs that are present and weighted by their number (Stoffer and
/// Toloi 1992); without them it is the usual biased estimate.
///
/// # Errors
/// Returns [`SignalError::TooShort`] with fewer than twice as many samples as lags, [`SignalError::Constant`],
/// [`SignalError::Infinite`] or [`SignalError::Setting`].
pub fn whiteness(residuals: ArrayView2<f64>, options: &WhitenessOptions) -> Result<Vec<Correlation>, SignalError> {
    check_record("the residual", residuals)?;
    let quantile = two_sided_quantile(options.confidence)?;
    if options.lags <= options.fitted_parameters {
        return Err(SignalError::Setting {
            name: "lags",
            value: options.lags as f64,
            allowed: "more than the number of fitted parameters",
        });
    }
    let columns = residuals.columns().into_iter().enumerate();
    columns.map(|(channel, column)| one_channel(channel, column.iter().copied(), options, quantile)).collect()
}

fn one_channel(
    channel: usize,
    series: impl Iterator<Item = f64> + Clone,
    options: &WhitenessOptions,
    quantile: f64,
) -> Result<Correlation, SignalError> {
    let there: Vec<bool> = series.clone().map(|x| !x.is_nan()).collect();
    let (e, present) = centred(series);
    if present < 2 * options.lags {
        return Err(SignalError::TooShort {
            what: "the whiteness test",
            unit: "samples",
            needed: 2 * options.lags,
            available: present,
        });
    }
    let total = e.len() as f64;
    let power = e.iter().map(|x| x * x).sum::<f64>() / present as f64;
    if power == 0.0 {
        return Err(SignalError::Constant { what: "the residual", channel });
    }
    let lags: Vec<i64> = (1..=options.lags as i64).collect();
    let (mut value, mut bound, mut statistic) = (Vec::new(), Vec::new(), 0.0);
    for lag in 1..=options.lags {
        let pairs = (lag..e.len()).filter(|&k| there[k] && there[k - lag]).count();
        if pairs == 0 {
            return Err(SignalError::TooShort {
                what: "the whiteness test",
                unit: "pairs at a lag",
                needed: 1,
                available: 0,
            });
        }
        let sum: f64 = (lag..e.len()).map(|k| e[k] * e[k - lag]).sum();
        let share = (total - lag as f64) / total;
        let correlation = sum / pairs as f64 / power * share;
        // This is the variance of the mean of `pairs` products of white noise; for a complete record it gives Ljung and
        // Box's n (n + 2) r^2 / (n - lag).
        let variance = share * share / pairs as f64;
        statistic += correlation * correlation / variance * (present as f64 + 2.0) / present as f64;
        value.push(correlation);
        bound.push(quantile * variance.sqrt());
    }
    let outside = lags_outside(&lags, &value, &bound);
    let test = CorrelationTest::new(statistic, options.lags - options.fitted_parameters, options.confidence, outside);
    Ok(Correlation { lags, value, bound, test })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::signal::test_noise::{coloured, white};
    use ndarray::{Array2, array};

    #[test]
    fn a_short_series_worked_by_hand() {
        // e = 1, -1, 2, -2: power 10/4, lag-1 sum -1 - 2 - 4 = -7, lag-2 sum 2 + 2 = 4.
        let e = array![[1.0], [-1.0], [2.0], [-2.0]];
        let result = &whiteness(e.view(), &WhitenessOptions { lags: 2, ..Default::default() }).unwrap()[0];
        assert!((result.value[0] + 0.7).abs() < 1e-15 && (result.value[1] - 0.4).abs() < 1e-15);
        // n (n + 2) (r1^2 / 3 + r2^2 / 2) = 24 (0.49 / 3 + 0.16 / 2) = 5.84; chi-squared with 2: p = exp(-2.92).
        assert!((result.test.statistic - 5.84).abs() < 1e-12);
        assert!((result.test.p_value - (-2.92f64).exp()).abs() < 1e-10);
    }

    #[test]
    fn white_noise_is_seldom_rejected_with_gaps_and_without() {
        for gaps in [false, true] {
            let mut e = white(21, 600, 500);
            if gaps {
                let holes = white(22, 600, 500);
                e.zip_mut_with(&holes, |x, h| {
                    if *h > 0.8 {
                        *x = f64::NAN
                    }
                });
            }
            let options = WhitenessOptions { lags: 20, fitted_parameters: 0, confidence: 0.95 };
            let results = whiteness(e.view(), &options).unwrap();
            let alarms = results.iter().filter(|r| !r.test.passes).count();
            // 25 of 500 are expected, with a standard deviation of 4.9.
            assert!((11..=42).contains(&alarms), "{gaps} {alarms}");
            let outside: usize = results.iter().map(|r| r.test.outside.len()).sum();
            let share = outside as f64 / (500.0 * 20.0);
            assert!((share - 0.05).abs() < 0.008, "{gaps} {share}");
        }
    }

    #[test]
    fn coloured_noise_is_found_and_shows_its_correlation() {
        let result = &whiteness(coloured(23, 20_000, 1, 0.6).view(), &WhitenessOptions::default()).unwrap()[0];
        assert!(!result.test.passes && result.test.p_value < 1e-12);
        for lag in 0..3 {
            assert!((result.value[lag] - 0.6f64.powi(lag as i32 + 1)).abs() < 0.03);
        }
        assert!(result.test.outside.starts_with(&[1, 2, 3]));
    }

    #[test]
    fn bad_residuals_are_refused() {
        let short = whiteness(white(1, 60, 1).view(), &WhitenessOptions::default()).unwrap_err();
        assert!(matches!(short, SignalError::TooShort { needed: 100, available: 60, .. }));
        let still = whiteness(Array2::from_elem((200, 1), 3.0).view(), &WhitenessOptions::default()).unwrap_err();
        assert_eq!(still, SignalError::Constant { what: "the residual", channel: 0 });
        let sure = WhitenessOptions { confidence: 1.0, ..Default::default() };
        assert!(matches!(whiteness(white(1, 200, 1).view(), &sure), Err(SignalError::Setting { .. })));
        let many = WhitenessOptions { fitted_parameters: 50, ..Default::default() };
        assert!(matches!(whiteness(white(1, 200, 1).view(), &many), Err(SignalError::Setting { .. })));
    }
}
