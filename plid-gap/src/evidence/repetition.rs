//! The share of a residual that repeats in every period of a periodic input. The cause of this part is driven by the
//! input. The rest is noise, or a disturbance that is independent of the input.

use crate::case::record::{Channels, Excitation, Record};
use plid_report::percent;

/// Returns the share of the residual's power that repeats in every period of the periodic records, each output scaled
/// by its own power; `None` if no record has two periods after the first one, which contains a transient. `simulated`
/// computes the simulated outputs of a record (p channels), and is called for periodic records only. Missing samples
/// are left out.
pub(crate) fn repeats(records: &[Record], simulated: impl Fn(usize) -> Channels) -> Option<f64> {
    let (mut repeated, mut all) = (0.0, 0.0);
    for (k, record) in records.iter().enumerate() {
        let Excitation::Periodic(period) = record.excitation else { continue };
        for (error, y) in record.error_where_measured(&simulated(k)).iter().zip(&record.y) {
            let power: f64 = y.iter().filter(|y| y.is_finite()).map(|y| y * y).sum();
            if let Some([of_mean, whole]) = of_channel(error, period).filter(|_| power > 0.0) {
                repeated += of_mean / power;
                all += whole / power;
            }
        }
    }
    (all > 0.0).then(|| (repeated / all).clamp(0.0, 1.0))
}

/// Returns the sum of squares of the periodic part of a residual, less the contribution of noise to a mean over
/// periods, and the sum of squares of the whole residual. Both are over all periods but the first. Missing samples
/// are left out.
fn of_channel(error: &[f64], period: usize) -> Option<[f64; 2]> {
    if error.len() < 3 * period {
        return None;
    }
    let mut sums = [0.0; 2];
    for phase in 0..period {
        let each: Vec<f64> =
            error[period + phase..].iter().step_by(period).copied().filter(|e| e.is_finite()).collect();
        let count = each.len() as f64;
        if count < 2.0 {
            continue;
        }
        let mean = each.iter().sum::<f64>() / count;
        let variance = each.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / (count - 1.0);
        sums[0] += count * mean * mean - variance;
        sums[1] += each.iter().map(|e| e * e).sum::<f64>();
    }
    Some(sums)
}

/// States the share in a sentence.
pub(crate) fn words(repeats: f64) -> String {
    format!(
        "In the periodic records, {} of the remainder's power repeats in every period, so the input drives its cause; \
        the rest is noise or a disturbance.",
        percent(repeats)
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;

    /// In a residual of a periodic part and white noise, the share follows from the powers of both, whatever the
    /// number of periods. Missing samples change nothing, and a record without a period contributes nothing.
    #[test]
    fn the_periodic_part_is_told_from_the_noise() {
        let period = 500;
        for (periods, size, noise) in [(4, 0.5, 0.5), (8, 1.0, 0.0), (8, 0.0, 1.0), (8, 1.0, 0.3)] {
            let one = testing::random_input(1, period, 1).remove(0);
            let other = testing::random_input(2, periods * period, 1).remove(0);
            let error: Vec<f64> = other.iter().enumerate().map(|(k, e)| size * one[k % period] + noise * e).collect();
            let power = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>() / x.len() as f64;
            let (driven, rest) = (size * size * power(&one), noise * noise * power(&other));
            let expected = driven / (driven + rest);
            let mut y = testing::random_input(3, periods * period, 1).remove(0);
            let simulated: Channels = vec![y.iter().zip(&error).map(|(y, error)| y - error).collect()];
            // Half of a period was not measured.
            y[period..period + period / 2].fill(f64::NAN);
            let of = |excitation| Record { excitation, ..testing::record(Vec::new(), vec![y.clone()]) };
            let found = repeats(&[of(Excitation::Periodic(period))], |_| simulated.clone()).unwrap();
            assert!((found - expected).abs() < 0.06, "{found} instead of {expected}");
            assert_eq!(repeats(&[of(Excitation::Random)], |_| simulated.clone()), None);
            assert_eq!(repeats(&[of(Excitation::Periodic(periods * period / 2))], |_| simulated.clone()), None);
        }
    }
}
