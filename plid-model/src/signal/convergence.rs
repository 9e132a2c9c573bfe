use ndarray::ArrayView2;

/// The convergence of a recursion as in the paper's Fig. 6: the largest one-step error over the outputs at each sample.
#[derive(Debug, Clone, PartialEq)]
pub struct Convergence {
    /// Largest |e| over the outputs at each sample, in the outputs' unit; NaN where all outputs are missing.
    pub largest: Vec<f64>,
    /// The largest error summarised in bins whose width grows with time.
    pub bins: Vec<ConvergenceBin>,
}

/// Percentiles of the largest error over a range of samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ConvergenceBin {
    /// First sample of the bin, counted from 0.
    pub start: usize,
    /// One past the last sample of the bin.
    pub end: usize,
    /// 10th percentile.
    pub low: f64,
    /// Median.
    pub median: f64,
    /// 90th percentile.
    pub high: f64,
    /// Largest value.
    pub peak: f64,
}

/// Computes the convergence curve of one-step `errors` (`samples x p`) in at most `bins` bins, equally spaced in the
/// logarithm of time. Missing errors (NaN) are excluded, and so is a bin that contains no others.
pub fn convergence(errors: ArrayView2<f64>, bins: usize) -> Convergence {
    let largest: Vec<f64> = errors
        .rows()
        .into_iter()
        .map(|row| row.iter().filter(|e| !e.is_nan()).map(|e| e.abs()).fold(f64::NAN, f64::max))
        .collect();
    let samples = largest.len();
    let mut edges: Vec<usize> = (0..=bins)
        .map(|b| ((samples as f64 + 1.0).powf(b as f64 / bins.max(1) as f64) - 1.0).round() as usize)
        .chain([samples])
        .collect();
    edges.dedup();
    let bins = edges.windows(2).filter_map(|edge| summary(edge[0], edge[1], &largest[edge[0]..edge[1]])).collect();
    Convergence { largest, bins }
}

fn summary(start: usize, end: usize, values: &[f64]) -> Option<ConvergenceBin> {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|x| !x.is_nan()).collect();
    sorted.sort_by(f64::total_cmp);
    let peak = *sorted.last()?;
    Some(ConvergenceBin {
        start,
        end,
        low: percentile(&sorted, 0.1),
        median: percentile(&sorted, 0.5),
        high: percentile(&sorted, 0.9),
        peak,
    })
}

/// Interpolates linearly between order statistics, like numpy's default.
fn percentile(sorted: &[f64], share: f64) -> f64 {
    let position = share * (sorted.len() - 1) as f64;
    let below = position.floor() as usize;
    let above = (below + 1).min(sorted.len() - 1);
    let weight = position - below as f64;
    // An infinite neighbour of zero weight must not give NaN.
    if weight == 0.0 { sorted[below] } else { sorted[below] * (1.0 - weight) + sorted[above] * weight }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::signal::test_noise::white;
    use ndarray::{Array2, array};

    #[test]
    fn the_largest_error_skips_gaps() {
        let e = array![[1.0, -3.0], [f64::NAN, 0.5], [f64::NAN, f64::NAN], [-2.0, 1.0]];
        let c = convergence(e.view(), 1);
        assert_eq!(c.largest[..2], [3.0, 0.5]);
        assert!(c.largest[2].is_nan());
        // Sorted 0.5, 2, 3: 10th percentile 0.5 + 0.2 * 1.5, 90th 2 + 0.8.
        let bin = c.bins[0];
        assert_eq!((bin.start, bin.end, bin.median, bin.peak), (0, 4, 2.0, 3.0));
        assert!((bin.low - 0.8).abs() < 1e-15 && (bin.high - 2.8).abs() < 1e-15);
    }

    #[test]
    fn bins_tile_the_record_and_follow_the_decay() {
        let mut e = white(41, 20_000, 3);
        for (k, mut row) in e.rows_mut().into_iter().enumerate() {
            row *= 1.0 / (1.0 + k as f64);
        }
        let c = convergence(e.view(), 60);
        assert_eq!((c.bins[0].start, c.bins.last().unwrap().end), (0, 20_000));
        assert!(c.bins.windows(2).all(|pair| pair[0].end == pair[1].start));
        assert!(c.bins.len() <= 60 && c.bins.len() > 35);
        // The median of the largest of three |normal| variables is 1.26 (0.5^(1/3) quantile of the half normal).
        for bin in c.bins.iter().filter(|bin| bin.end - bin.start > 500) {
            let middle = 1.0 + 0.5 * (bin.start + bin.end) as f64;
            assert!((bin.median * middle / 1.264 - 1.0).abs() < 0.15, "{bin:?}");
        }
        assert!(convergence(Array2::zeros((0, 2)).view(), 10).bins.is_empty());
    }
}
