use std::borrow::Borrow;

/// Returns the root mean square of the values that are not NaN, or 0 if there are none.
pub fn rms<T: Borrow<f64>>(values: impl IntoIterator<Item = T>) -> f64 {
    let present = values.into_iter().map(|x| *x.borrow()).filter(|x| !x.is_nan());
    let (sum, count) = present.fold((0.0, 0_usize), |(sum, count), x| (sum + x * x, count + 1));
    if count == 0 { 0.0 } else { (sum / count as f64).sqrt() }
}

/// Returns the mean of the values that are not NaN, or 0 if there are none.
pub fn mean<T: Borrow<f64>>(values: impl IntoIterator<Item = T>) -> f64 {
    let present = values.into_iter().map(|x| *x.borrow()).filter(|x| !x.is_nan());
    let (sum, count) = present.fold((0.0, 0_usize), |(sum, count), x| (sum + x, count + 1));
    if count == 0 { 0.0 } else { sum / count as f64 }
}

/// Returns the median, which for an even count is the mean of the two middle values. NaN counts as infinity, and the
/// median of an empty set is NaN.
pub fn median(values: &[f64]) -> f64 {
    let mut sorted: Vec<f64> = values.iter().map(|x| if x.is_nan() { f64::INFINITY } else { *x }).collect();
    sorted.sort_by(f64::total_cmp);
    match (sorted.len() / 2, sorted.len() % 2) {
        (0, 0) => f64::NAN,
        (half, 0) => 0.5 * (sorted[half - 1] + sorted[half]),
        (half, _) => sorted[half],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_values_are_left_out() {
        assert_eq!(rms([3.0, f64::NAN, 4.0]), 12.5f64.sqrt());
        assert_eq!(mean([3.0, f64::NAN, 4.0]), 3.5);
        assert_eq!((rms([f64::NAN]), mean(&[] as &[f64])), (0.0, 0.0));
    }

    #[test]
    fn medians_of_odd_and_even_counts() {
        assert_eq!(median(&[3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(&[4.0, 1.0, 2.0, 3.0]), 2.5);
        assert!(median(&[]).is_nan());
        assert_eq!(median(&[-f64::NAN, 1.0, 2.0]), 2.0);
    }
}
