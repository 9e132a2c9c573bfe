use nalgebra::{DMatrix, DVector, SymmetricEigen};
use ndarray::ArrayView2;

use super::correlation::{Correlation, CorrelationTest, centred, lags_outside, two_sided_quantile};
use super::error::{SignalError, check_record, check_rows};
use plid_fourier::sums_of_products;

/// Settings of [`cross_correlation`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CrossCorrelationOptions {
    /// First lag in samples: 1 for strictly past inputs, 0 if the plant has feedthrough, negative to detect feedback.
    pub first_lag: i64,
    /// Last lag in samples; positive lags are past inputs.
    pub last_lag: i64,
    /// Confidence level of the bounds and of the test.
    pub confidence: f64,
}

impl Default for CrossCorrelationOptions {
    fn default() -> Self {
        Self { first_lag: 1, last_lag: 50, confidence: 0.99 }
    }
}

/// Directions in lag space with less than this fraction of the largest variance are excluded from the statistic. A
/// narrow-band input produces such directions, for which the asymptotic variance does not hold.
const WEAK_DIRECTION: f64 = 1e-3;

/// Correlates each residual with each past input: element `[i][j]` belongs to column i of `residuals` (`samples x p`)
/// and column j of `inputs` (`samples x m`).
///
/// The bounds are Bartlett's for two independent series, var r(lag) = sum_k rho_e(k) rho_u(k) / N (Box and Jenkins,
/// Time Series Analysis, section 12.1.3), so that coloured residuals with a coloured input are not mistaken for a
/// model error. The test statistic is r^T V^{-1} r with Bartlett's covariances V between the lags. It has one degree
/// of freedom for each direction of V that carries variance. Missing samples are excluded from all sums.
///
/// # Errors
/// Returns [`SignalError::TooShort`] with fewer samples than four times the lags, [`SignalError::Constant`],
/// [`SignalError::LengthMismatch`], [`SignalError::Infinite`] or [`SignalError::Setting`].
pub fn cross_correlation(
    residuals: ArrayView2<f64>,
    inputs: ArrayView2<f64>,
    options: &CrossCorrelationOptions,
) -> Result<Vec<Vec<Correlation>>, SignalError> {
    check_record("the residual", residuals)?;
    check_record("the input", inputs)?;
    check_rows("the input", inputs, residuals.nrows())?;
    let quantile = two_sided_quantile(options.confidence)?;
    if options.last_lag < options.first_lag {
        return Err(SignalError::Setting {
            name: "last lag",
            value: options.last_lag as f64,
            allowed: "at least the first lag",
        });
    }
    let span = (options.last_lag - options.first_lag + 1) as usize;
    let reach = options.first_lag.unsigned_abs().max(options.last_lag.unsigned_abs()) as usize;
    let prepare = |what: &'static str, data: ArrayView2<f64>| -> Result<Vec<Series>, SignalError> {
        let needed = 4 * reach.max(span);
        data.columns()
            .into_iter()
            .enumerate()
            .map(|(c, column)| Series::new(what, c, column.iter().copied(), needed))
            .collect()
    };
    let residuals = prepare("the residual", residuals)?;
    let inputs = prepare("the input", inputs)?;
    Ok(residuals.iter().map(|e| inputs.iter().map(|u| one_pair(e, u, options, quantile)).collect()).collect())
}

/// A centred series with its sums of products at each lag.
struct Series {
    value: Vec<f64>,
    /// sum_t x_t x_{t+k} for k = 0, 1, ...
    products: Vec<f64>,
    present: usize,
}

impl Series {
    fn new(
        what: &'static str,
        channel: usize,
        series: impl Iterator<Item = f64> + Clone,
        needed: usize,
    ) -> Result<Self, SignalError> {
        let (value, present) = centred(series);
        if present < needed {
            return Err(SignalError::TooShort {
                what: "the cross-correlation test",
                unit: "samples",
                needed,
                available: present,
            });
        }
        let products = sums_of_products(&value);
        if products[0] <= 0.0 {
            return Err(SignalError::Constant { what, channel });
        }
        Ok(Self { value, products, present })
    }
}

fn one_pair(e: &Series, u: &Series, options: &CrossCorrelationOptions, quantile: f64) -> Correlation {
    let lags: Vec<i64> = (options.first_lag..=options.last_lag).collect();
    let scale = (e.products[0] * u.products[0]).sqrt();
    let n = e.value.len() as i64;
    let value: Vec<f64> = lags
        .iter()
        .map(|&lag| {
            (lag.max(0)..n.min(n + lag)).map(|k| e.value[k as usize] * u.value[(k - lag) as usize]).sum::<f64>() / scale
        })
        .collect();
    let covariance: Vec<f64> = (0..lags.len()).map(|apart| bartlett(e, u, apart)).collect();
    let bound = vec![quantile * covariance[0].sqrt(); lags.len()];

    let toeplitz = DMatrix::from_fn(lags.len(), lags.len(), |i, j| covariance[i.abs_diff(j)]);
    let eigen = SymmetricEigen::new(toeplitz);
    let along = eigen.eigenvectors.tr_mul(&DVector::from_column_slice(&value));
    let least = WEAK_DIRECTION * eigen.eigenvalues.max();
    let (mut statistic, mut freedom) = (0.0, 0);
    for (component, variance) in along.iter().zip(eigen.eigenvalues.iter()).filter(|(_, variance)| **variance > least) {
        statistic += component * component / variance;
        freedom += 1;
    }
    let outside = lags_outside(&lags, &value, &bound);
    Correlation { test: CorrelationTest::new(statistic, freedom, options.confidence, outside), lags, value, bound }
}

/// Returns Bartlett's covariance of the cross-correlations at two lags that are `apart` samples apart: sum_k rho_e(k)
/// rho_u(k + apart) / N. With gaps filled by zeros the sums contain only the pairs that are present.
fn bartlett(e: &Series, u: &Series, apart: usize) -> f64 {
    let at = |products: &[f64], k: i64| products.get(k.unsigned_abs() as usize).copied().unwrap_or(0.0);
    let n = e.products.len() as i64;
    let sum: f64 = (1 - n..n).map(|k| at(&e.products, k) * at(&u.products, k + apart as i64)).sum();
    sum / (e.products[0] * u.products[0] * u.present as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::signal::test_noise::{coloured, white};
    use ndarray::{Array2, array};

    fn share_outside(e: &Array2<f64>, u: &Array2<f64>) -> (f64, f64) {
        let options = CrossCorrelationOptions { first_lag: 0, last_lag: 19, confidence: 0.95 };
        let (mut outside, mut alarms, mut count) = (0, 0, 0);
        for column in 0..e.ncols() {
            let pick = |data: &Array2<f64>| data.column(column).insert_axis(ndarray::Axis(1)).to_owned();
            let result = &cross_correlation(pick(e).view(), pick(u).view(), &options).unwrap()[0][0];
            outside += result.test.outside.len();
            alarms += usize::from(!result.test.passes);
            count += 1;
        }
        (outside as f64 / (20 * count) as f64, alarms as f64 / count as f64)
    }

    #[test]
    fn lags_worked_by_hand() {
        // The residual is the input delayed by two samples, so lag 2 must exceed its bound and few other lags may.
        let u = white(31, 4000, 1);
        let e = Array2::from_shape_fn((4000, 1), |(k, _)| if k > 1 { u[[k - 2, 0]] } else { 0.0 });
        let options = CrossCorrelationOptions { first_lag: -5, ..Default::default() };
        let result = &cross_correlation(e.view(), u.view(), &options).unwrap()[0][0];
        assert!((result.value[7] - 1.0).abs() < 5e-3 && result.lags[7] == 2);
        assert!(result.test.outside.contains(&2) && result.test.outside.len() < 4 && !result.test.passes);
    }

    #[test]
    fn the_bound_holds_for_white_and_for_coloured_series() {
        // For two first-order series Bartlett's sum is (1 + ab) / (1 - ab), which is 6.1 for 0.8 and 0.9. Bounds that
        // assume a white residual would be exceeded by 43 % of the values.
        for (pole_e, pole_u) in [(0.0, 0.0), (0.0, 0.9), (0.8, 0.9)] {
            let (outside, alarms) = share_outside(&coloured(32, 2000, 300, pole_e), &coloured(33, 2000, 300, pole_u));
            assert!((outside - 0.05).abs() < 0.03, "{pole_e} {pole_u}: {outside}");
            assert!((alarms - 0.05).abs() < 0.045, "{pole_e} {pole_u}: {alarms}");
        }
    }

    #[test]
    fn the_bound_is_the_closed_form_of_two_first_order_series() {
        let options = CrossCorrelationOptions::default();
        let n = 100_000;
        let result =
            &cross_correlation(coloured(34, n, 1, 0.8).view(), coloured(35, n, 1, 0.9).view(), &options).unwrap()[0][0];
        let expected = 2.575829 * ((1.0f64 + 0.72) / (1.0 - 0.72) / n as f64).sqrt();
        assert!((result.bound[0] / expected - 1.0).abs() < 0.05, "{} {expected}", result.bound[0]);
    }

    #[test]
    fn the_bound_holds_with_gaps() {
        let mut e = coloured(36, 2000, 300, 0.8);
        e.zip_mut_with(&white(37, 2000, 300), |x, h| {
            if *h > 0.7 {
                *x = f64::NAN
            }
        });
        let (outside, alarms) = share_outside(&e, &coloured(38, 2000, 300, 0.9));
        assert!((outside - 0.05).abs() < 0.03, "{outside}");
        assert!((alarms - 0.05).abs() < 0.045, "{alarms}");
    }

    #[test]
    fn a_narrow_band_input_leaves_fewer_degrees_of_freedom() {
        // Two poles at 0.97 confine the input to a small part of the band.
        let mut u = coloured(39, 8000, 1, 0.97);
        for k in 1..8000 {
            u[[k, 0]] += 0.97 * u[[k - 1, 0]];
        }
        let result =
            &cross_correlation(white(40, 8000, 1).view(), u.view(), &CrossCorrelationOptions::default()).unwrap()[0][0];
        assert!((1..25).contains(&result.test.degrees_of_freedom), "{}", result.test.degrees_of_freedom);
        assert!(result.test.p_value > 0.01);
    }

    #[test]
    fn bad_records_are_refused() {
        let options = CrossCorrelationOptions::default();
        let e = white(1, 300, 1);
        let still = cross_correlation(e.view(), Array2::zeros((300, 1)).view(), &options).unwrap_err();
        assert_eq!(still, SignalError::Constant { what: "the input", channel: 0 });
        let short = cross_correlation(array![[1.0]].view(), array![[1.0]].view(), &options).unwrap_err();
        assert!(matches!(short, SignalError::TooShort { needed: 200, available: 1, .. }));
        let other = cross_correlation(e.view(), white(1, 200, 1).view(), &options).unwrap_err();
        assert_eq!(other, SignalError::LengthMismatch { what: "the input", expected: 300, found: 200 });
    }
}
