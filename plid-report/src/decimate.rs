/// Cuts a series at its gaps (points that are not finite) into runs, and thins each run to the points that `pixels`
/// columns can show, which are the lowest and the highest point of each column. `column` returns the horizontal
/// position of x in pixels. A run in which x is not monotonic is not thinned.
pub(super) fn decimate(points: &[(f64, f64)], pixels: f64, column: impl Fn(f64) -> f64) -> Vec<Vec<(f64, f64)>> {
    points
        .split(|(x, y)| !x.is_finite() || !y.is_finite() || !column(*x).is_finite())
        .filter(|run| !run.is_empty())
        .map(|run| if run.len() as f64 > 2.0 * pixels { thin(run, &column) } else { run.to_vec() })
        .collect()
}

fn thin(run: &[(f64, f64)], column: &impl Fn(f64) -> f64) -> Vec<(f64, f64)> {
    if run.windows(2).any(|pair| pair[1].0 < pair[0].0) {
        return run.to_vec();
    }
    let mut result = Vec::new();
    for bucket in run.chunk_by(|a, b| column(a.0).floor() == column(b.0).floor()) {
        let by_y = |a: &&(f64, f64), b: &&(f64, f64)| a.1.total_cmp(&b.1);
        let (Some(low), Some(high)) = (bucket.iter().min_by(by_y), bucket.iter().max_by(by_y)) else {
            continue;
        };
        result.extend(if low.0 < high.0 { [*low, *high] } else { [*high, *low] });
    }
    result.dedup();
    result
}

/// Drops points that fall on a pixel already drawn.
pub(super) fn thin_points(points: &[(f64, f64)], pixel: impl Fn(f64, f64) -> (f64, f64)) -> Vec<(f64, f64)> {
    let mut taken = std::collections::HashSet::new();
    let visible = |&(x, y): &(f64, f64)| {
        let (column, row) = pixel(x, y);
        column.is_finite() && row.is_finite() && taken.insert((column.round() as i64, row.round() as i64))
    };
    points.iter().copied().filter(visible).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_series_keeps_its_extremes_and_its_gaps() {
        let mut points: Vec<(f64, f64)> = (0..20_000).map(|k| (k as f64, (k as f64 * 0.7).sin())).collect();
        points[5_003].1 = 40.0;
        points[9_001].1 = -30.0;
        points[12_000].1 = f64::NAN;
        let runs = decimate(&points, 500.0, |x| x / 40.0);
        assert_eq!(runs.len(), 2);
        let all: Vec<_> = runs.concat();
        assert!(all.len() <= 2 * 501 && all.len() > 900);
        assert!(all.contains(&(5_003.0, 40.0)) && all.contains(&(9_001.0, -30.0)));
        assert!(all.windows(2).all(|pair| pair[0].0 <= pair[1].0));
        assert!(runs[0].iter().all(|p| p.0 < 12_000.0) && runs[1].iter().all(|p| p.0 > 12_000.0));
    }

    #[test]
    fn short_series_and_curves_that_turn_back_are_left_alone() {
        let circle: Vec<(f64, f64)> = (0..5000).map(|k| ((k as f64 / 100.0).cos(), (k as f64 / 100.0).sin())).collect();
        assert_eq!(decimate(&circle, 100.0, |x| 50.0 * x), std::slice::from_ref(&circle));
        assert_eq!(decimate(&circle[..10], 100.0, |x| x), [circle[..10].to_vec()]);
        // A point that a logarithmic axis cannot show is a gap.
        assert_eq!(decimate(&[(0.0, 1.0), (1.0, 1.0)], 9.0, f64::ln), [[(1.0, 1.0)]]);
        assert_eq!(thin_points(&[(0.0, 0.0), (0.1, 0.1), (2.0, 0.0), (1.0, f64::NAN)], |x, y| (x, y)).len(), 2);
    }
}
