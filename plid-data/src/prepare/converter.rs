//! The quantisation step of the analogue-to-digital converter, estimated from the data.
use ndarray::ArrayView1;
use serde::{Deserialize, Serialize};

/// The step of a channel's converter.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ConverterStep {
    /// Quantum q in the channel's units.
    pub step: f64,
    /// Variance of the rounding to this step, q^2 / 12.
    pub variance: f64,
    /// Number of distinct values in the data.
    pub codes: usize,
}

/// Finds the smallest common step of the values of a channel.
///
/// Returns `None` if no step is visible: the median distance between neighbouring values must be one step, and all
/// values must lie on multiples of it to within a tenth of a step. Data that are merely printed with few digits fail
/// this test, unless their step is the same at all magnitudes.
pub fn converter_step(values: ArrayView1<f64>) -> Option<ConverterStep> {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let (low, high) = (*sorted.first()?, *sorted.last()?);
    // Values that differ only by rounding errors of the arithmetic count as one value.
    let same = 1e-12 * (high - low).max(low.abs()).max(high.abs());
    sorted.dedup_by(|a, b| *a - *b <= same);
    let mut gaps: Vec<f64> = sorted.windows(2).map(|w| w[1] - w[0]).collect();
    if gaps.len() < 3 {
        return None;
    }
    gaps.sort_by(f64::total_cmp);
    let usual = gaps[gaps.len() / 2];
    // Codes are counted gap by gap, so that a small error of the usual gap does not accumulate.
    let mut code = 0.0;
    let codes: Vec<f64> = std::iter::once(0.0)
        .chain(sorted.windows(2).map(|w| {
            code += ((w[1] - w[0]) / usual).round();
            code
        }))
        .collect();
    let count = codes.len() as f64;
    let code_mean = codes.iter().sum::<f64>() / count;
    let value_mean = sorted.iter().sum::<f64>() / count;
    let pairs = || codes.iter().zip(&sorted);
    let across: f64 = pairs().map(|(n, v)| (n - code_mean) * (v - value_mean)).sum();
    let along: f64 = codes.iter().map(|n| (n - code_mean).powi(2)).sum();
    if along == 0.0 {
        return None;
    }
    let step = across / along;
    let off = |(n, v): (&f64, &f64)| (v - value_mean - step * (n - code_mean)).abs();
    let fits = pairs().all(|pair| off(pair) <= 0.1 * step);
    (fits && step > 0.0).then_some(ConverterStep { step, variance: step * step / 12.0, codes: codes.len() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::test_plants::Gaussian;
    use ndarray::Array1;

    fn gaussian(samples: usize) -> Array1<f64> {
        let mut g = Gaussian::new(11);
        (0..samples).map(|_| 0.5 * g.draw()).collect()
    }

    #[test]
    fn the_step_of_a_12_bit_converter_is_found() {
        let step = 10.0 / 4096.0;
        let exact = gaussian(20_000).mapv(|v| (v / step).round() * step + 0.0123);
        // These are the same values as a file with six decimals contains them.
        let printed = exact.mapv(|v| (v * 1e6).round() / 1e6);
        for values in [exact, printed] {
            let found = converter_step(values.view()).unwrap();
            assert!((found.step / step - 1.0).abs() < 1e-5, "{found:?}");
            assert!((found.variance / (step * step / 12.0) - 1.0).abs() < 1e-4);
        }
    }

    #[test]
    fn smooth_or_significant_digit_data_show_no_step() {
        assert_eq!(converter_step(gaussian(5000).view()), None);
        let five_digits = gaussian(5000).mapv(|v| format!("{v:.4e}").parse::<f64>().unwrap());
        assert_eq!(converter_step(five_digits.view()), None);
        assert_eq!(converter_step(Array1::zeros(100).view()), None);
        assert_eq!(converter_step(Array1::from(vec![f64::NAN; 3]).view()), None);
    }
}
