//! The plot of a sweep: errors against the first key that has numbers, with a curve for each setting of the others.

use super::grid::Sweep;
use super::point::Row;
use super::table::{self, MODELS};
use plid_report::{Axis, Chart, Series, charts};

/// Largest number of curves in one plot. More curves cannot be distinguished, and are drawn as points of one kind.
const MOST_CURVES: usize = 8;

/// An axis that spans more than this factor is logarithmic.
const WIDE: f64 = 50.0;

/// Draws the free-run errors of each model as SVG. If no key has several numbers, they are drawn against the number
/// of the point. Returns `None` if no run has such an error.
pub(super) fn picture(sweep: &Sweep, rows: &[Row]) -> Option<String> {
    let along = abscissa(sweep, rows);
    let x = |row: &Row| along.map_or(&row.number, |key| &row.values[key]).parse().unwrap_or(f64::NAN);
    let label = along.map_or("point", |key| &sweep.varied[key].key);
    let xs: Vec<f64> = rows.iter().map(x).collect();
    let axis = axis(label, &xs);
    let panel = |&(name, model): &(&str, &str)| {
        let error = |row: &Row| Some(100.0 * table::number(row, name)?);
        let errors: Vec<f64> = rows.iter().filter_map(error).collect();
        let point = |row: &Row| Some((others(sweep, along, row), (x(row), error(row)?)));
        let series = series(rows.iter().filter_map(point), along.is_some());
        let y = self::axis(&format!("{model} model, %"), &errors);
        let y = Axis { range: None, ..y };
        (!errors.is_empty()).then(|| Chart { title: String::new(), x: axis.clone(), y, series, height: 220.0 })
    };
    let panels: Vec<Chart> = MODELS.iter().filter_map(panel).collect();
    (!panels.is_empty()).then(|| charts(&panels))
}

/// Returns the position of the first key with several values, all of which are numbers.
fn abscissa(sweep: &Sweep, rows: &[Row]) -> Option<usize> {
    (0..sweep.varied.len()).find(|&key| {
        let is_number = |row: &Row| row.values[key].parse::<f64>().is_ok();
        sweep.varied[key].values.len() > 1 && rows.iter().all(is_number)
    })
}

/// Returns an axis for these values.
fn axis(label: &str, values: &[f64]) -> Axis {
    let (low, high) = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), &v| (a.min(v), b.max(v)));
    let axis = if low > 0.0 && high > WIDE * low { Axis::log(label) } else { Axis::linear(label) };
    if low < high { axis.range(low, high) } else { axis }
}

/// Returns the setting of all keys except the one along the axis.
fn others(sweep: &Sweep, along: Option<usize>, row: &Row) -> String {
    let keys = sweep.varied.iter().zip(&row.values).enumerate().filter(|(key, _)| Some(*key) != along);
    keys.map(|(_, (varied, value))| format!("{} = {value}", varied.key)).collect::<Vec<_>>().join(", ")
}

/// Returns a curve for each setting. It returns points if there are too many settings, or if no axis orders the
/// values.
fn series(points: impl Iterator<Item = (String, (f64, f64))>, is_ordered: bool) -> Vec<Series> {
    let mut curves: Vec<(String, Vec<(f64, f64)>)> = Vec::new();
    for (setting, point) in points {
        match curves.iter_mut().find(|(known, _)| *known == setting) {
            Some((_, curve)) => curve.push(point),
            None => curves.push((setting, vec![point])),
        }
    }
    if !is_ordered || curves.len() > MOST_CURVES {
        return vec![Series::points("", curves.into_iter().flat_map(|(_, curve)| curve).collect())];
    }
    let line = |(setting, mut curve): (String, Vec<(f64, f64)>)| {
        curve.sort_by(|a, b| a.0.total_cmp(&b.0));
        // A line needs two points.
        if curve.len() == 1 { Series::points(setting, curve) } else { Series::line(setting, curve) }
    };
    curves.into_iter().map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(settings: usize) -> impl Iterator<Item = (String, (f64, f64))> {
        (0..2 * settings).map(move |i| (format!("s{}", i % settings), ((2 * settings - i) as f64, 1.0)))
    }

    #[test]
    fn few_settings_are_curves_and_many_are_points() {
        let curve = |setting: &str, xs: [f64; 2]| Series::line(setting, xs.map(|x| (x, 1.0)).to_vec());
        assert_eq!(series(points(2), true), [curve("s0", [2.0, 4.0]), curve("s1", [1.0, 3.0])]);
        assert_eq!(series(points(9), true).len(), 1);
        assert_eq!(series(points(2), false).len(), 1);
    }

    #[test]
    fn an_axis_is_logarithmic_where_its_values_are_far_apart() {
        assert_eq!(axis("x", &[1.0, 50.0]), Axis::linear("x").range(1.0, 50.0));
        assert_eq!(axis("x", &[1e-6, 1e-2]), Axis::log("x").range(1e-6, 1e-2));
        assert_eq!(axis("x", &[0.0, 100.0]), Axis::linear("x").range(0.0, 100.0));
        assert_eq!(axis("x", &[2.0, 2.0]), Axis::linear("x"));
    }
}
