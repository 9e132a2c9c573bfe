use super::figure::single;
use super::panel::{Axis, Panel, Series};

/// Any number of series on one pair of axes.
#[derive(Debug, Clone, PartialEq)]
pub struct Chart {
    /// The title above the data; may be empty.
    pub title: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// The series, of which later ones are drawn above earlier ones.
    pub series: Vec<Series>,
    /// Height of the data area in pixels, at a figure width of 900.
    pub height: f64,
}

/// Draws a chart as SVG. It is for data without a plot function of their own.
pub fn chart(chart: &Chart) -> String {
    charts(std::slice::from_ref(chart))
}

/// Draws charts one below the other under the title of the first. They share the horizontal axis, which is labelled
/// below the last chart, so all must have the same range.
pub fn charts(charts: &[Chart]) -> String {
    let panel = |chart: &Chart| Panel::new(chart.x.clone(), chart.y.clone(), chart.height, chart.series.clone());
    single(charts.first().map_or("", |first| &first.title), charts.iter().map(panel).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plot(x: Axis, y: Axis, series: Vec<Series>) -> String {
        chart(&Chart { title: "t".into(), x, y, series, height: 200.0 })
    }

    #[test]
    fn the_same_data_give_the_same_bytes() {
        let draw = || plot(Axis::linear("x"), Axis::log("y"), vec![Series::line("a", vec![(0.0, 1.0), (1.0, 1e3)])]);
        let first = draw();
        assert_eq!(first, draw());
        assert!(first.starts_with("<svg viewBox=\"0 0 900.00 ") && first.contains("plid-clip-0"));
    }

    #[test]
    fn charts_stand_below_each_other_with_one_legend() {
        let one = |label: &str| Chart {
            title: label.into(),
            x: Axis::linear("x"),
            y: Axis::linear(label),
            series: vec![Series::line("same", vec![(0.0, 1.0), (1.0, 2.0)])],
            height: 100.0,
        };
        let svg = charts(&[one("above"), one("below")]);
        assert_eq!((svg.matches(">same<").count(), svg.matches(">x<").count()), (1, 1));
        // The title of the first, and the names of both vertical axes.
        assert_eq!((svg.matches(">above<").count(), svg.matches(">below<").count()), (2, 1));
        assert!(charts(&[]).starts_with("<svg"));
    }

    #[test]
    fn labels_are_escaped() {
        let svg = plot(
            Axis::linear("a<b"),
            Axis::linear("c&d"),
            vec![Series::line("<script>", vec![(0.0, 1.0), (1.0, 2.0)])],
        );
        assert!(!svg.contains("<script") && svg.contains("a&lt;b") && svg.contains("c&amp;d"));
    }

    #[test]
    fn odd_data_are_drawn_without_nonsense() {
        let nan = f64::NAN;
        let odd: Vec<Vec<(f64, f64)>> = vec![
            vec![],
            vec![(nan, nan)],
            vec![(1.0, 5.0)],
            vec![(0.0, 0.0), (1.0, 0.0)],
            vec![(0.0, -1.0), (1.0, f64::INFINITY), (2.0, 3.0)],
            vec![(1.0, 1e-300), (2.0, 1e300)],
            vec![(1e-14, 1e-18), (2e-14, 3e-18)],
        ];
        for points in odd {
            for axis in [Axis::linear("x"), Axis::log("x")] {
                let band = points.iter().map(|&(x, y)| (x, y - 1.0, y + 1.0)).collect();
                let series = vec![
                    Series::band("band", band),
                    Series::line("line", points.clone()),
                    Series::points("points", points.clone()),
                    Series::stems("stems", points.clone()),
                    Series::area("area", points.clone()),
                ];
                let svg = plot(axis.clone(), axis, series);
                assert!(!svg.contains("NaN") && !svg.contains("inf"), "{points:?}");
                assert!(svg.len() < 60_000, "{points:?}: {} bytes", svg.len());
            }
        }
    }

    #[test]
    fn a_long_series_stays_small() {
        let long: Vec<(f64, f64)> = (0..200_000u64).map(|k| (k as f64, ((k * k) % 7919) as f64)).collect();
        assert!(plot(Axis::linear("x"), Axis::linear("y"), vec![Series::line("", long)]).len() < 50_000);
    }
}
