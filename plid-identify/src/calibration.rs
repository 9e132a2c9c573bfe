//! The ratio of the innovations' mean square to the variance that the covariances predict.

use plid_core::{Dense, IdentifiedModel, ImplicitModel, ObservableForm};

/// The final fraction of the training data whose innovations count, because the recursion has converged by then.
const SETTLED: f64 = 0.25;

/// Returns the mean square of the last innovations over their variance according to P and R at the end, averaged over
/// the outputs. The ratio is 1 if the noise covariances have the right size; otherwise the covariance of the estimate
/// is too small by this factor. `innovations` holds one array (K x p) per record.
pub fn innovation_ratio(
    form: &ObservableForm,
    sensor: &Dense<f64>,
    identified: &IdentifiedModel,
    innovations: &[ndarray::Array2<f64>],
) -> f64 {
    let total: usize = innovations.iter().map(|record| record.nrows()).sum();
    let skipped = total - ((SETTLED * total as f64).ceil() as usize).min(total);
    let rows = || innovations.iter().flat_map(|record| record.rows()).skip(skipped);
    let ratios: Vec<f64> = form
        .output_states()
        .iter()
        .enumerate()
        .filter_map(|(i, &c)| {
            let there = rows().map(|row| row[i]).filter(|e| e.is_finite());
            let (sum, count) = there.fold((0.0, 0usize), |(sum, count), e| (sum + e * e, count + 1));
            let expected = identified.covariance.at(c, c) + sensor.at(i, i);
            (count > 0 && expected > 0.0).then(|| sum / count as f64 / expected)
        })
        .collect();
    ratios.iter().sum::<f64>() / ratios.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;

    /// The innovations have twice the expected RMS after an initial part that must not count, and one of them is
    /// missing.
    #[test]
    fn the_ratio_is_that_of_the_settled_innovations() {
        let form = ObservableForm::new(&[1, 1], 1).unwrap();
        let mut variances = vec![1.0; form.joint_states()];
        variances[..2].copy_from_slice(&[0.5, 1.0]);
        let estimate = vec![0.1; form.joint_states()];
        let identified = IdentifiedModel::from_estimate(&form, &estimate, &Dense::from_diagonal(&variances));
        let sensor = Dense::from_diagonal(&[0.5, 3.0]);
        let sign = |k: usize| if k.is_multiple_of(3) { 1.0 } else { -1.0 };
        let late = |k: usize, i: usize| if i == 0 { 2.0 } else { 4.0 } * sign(k);
        let mut record = Array2::from_shape_fn((300, 2), |(k, i)| if k < 225 { 1e3 } else { late(k, i) });
        record[[250, 1]] = f64::NAN;
        let ratio = innovation_ratio(&form, &sensor, &identified, &[record]);
        assert!((ratio - 4.0).abs() < 1e-12, "{ratio}");
    }
}
