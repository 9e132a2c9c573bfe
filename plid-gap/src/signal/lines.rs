//! Lines of periodic signals.

use crate::case::record::Channels;
use plid_fourier::C;

/// Returns, for each line of a period (0, 1, 2, ... cycles), whether one of the inputs drives it: whether its power is
/// more than a share `least` of the power of the input's strongest line. The mean of an input drives nothing.
pub(crate) fn driven(u: &Channels, period: usize, least: f64) -> Vec<bool> {
    let mut driven = vec![false; period / 2 + 1];
    for u in u {
        let lines = periods(u, period, &used(u.len(), period));
        let most = lines.iter().skip(1).map(|line| line.0).fold(0.0, f64::max);
        driven.iter_mut().zip(&lines).skip(1).for_each(|(driven, line)| *driven |= line.0 > least * most);
    }
    driven
}

/// Returns the first sample of each period that is used. If at least two periods follow the first one, the first one
/// is left out, because the plant settles during it.
pub(crate) fn used(samples: usize, period: usize) -> Vec<usize> {
    let all = samples / period.max(1);
    (usize::from(all > 2)..all).map(|k| k * period).collect()
}

/// Returns, for each line, the power of its periodic part over the periods that begin at `starts`, and the power of the
/// noise in it, which is NaN for a single period.
pub(crate) fn periods(x: &[f64], period: usize, starts: &[usize]) -> Vec<(f64, f64)> {
    let each: Vec<Vec<C>> = starts.iter().map(|&from| plid_fourier::forward(&x[from..from + period])).collect();
    let count = each.len() as f64;
    // The transform of a line is half its amplitude times the number of samples.
    let scale = 2.0 / (period * period) as f64;
    let line = |k: usize| {
        let mean = each.iter().map(|z| z[k]).sum::<C>() / count;
        let left: f64 = each.iter().map(|z| (z[k] - mean).norm_sqr()).sum();
        (scale * mean.norm_sqr(), scale * left / (count - 1.0) / count)
    };
    (0..=period / 2).map(line).collect()
}
