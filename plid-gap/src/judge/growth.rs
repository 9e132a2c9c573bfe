//! The growth of a size with the level of the inputs from record to record.

/// Returns whether the largest of these levels is more than `factor` times the smallest.
pub fn differ(levels: impl Iterator<Item = f64> + Clone, factor: f64) -> bool {
    levels.clone().fold(0.0, f64::max) > factor * levels.fold(f64::INFINITY, f64::min)
}

/// Returns the exponent of a power law of a size in the level, by least squares over the logarithms of the level and
/// the size of each record. Sizes of zero are left out. `None` if fewer than two records are left, or if the squared
/// distances of the levels' logarithms from their mean sum to less than `spread`.
pub fn exponent(records: impl Iterator<Item = (f64, f64)>, spread: f64) -> Option<f64> {
    let points = records.map(|(level, size)| (level.ln(), size.ln()));
    let usable: Vec<(f64, f64)> = points.filter(|(_, size)| size.is_finite()).collect();
    let n = usable.len() as f64;
    let (mean_x, mean_y) =
        (usable.iter().map(|(x, _)| x).sum::<f64>() / n, usable.iter().map(|(_, y)| y).sum::<f64>() / n);
    let square: f64 = usable.iter().map(|(x, _)| (x - mean_x).powi(2)).sum();
    if usable.len() < 2 || square < spread {
        return None;
    }
    Some(usable.iter().map(|(x, y)| (x - mean_x) * (y - mean_y)).sum::<f64>() / square)
}
