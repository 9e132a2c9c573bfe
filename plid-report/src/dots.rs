use kuva::plot::{LegendEntry, LegendShape};
use kuva::render::color::Color;
use kuva::render::render::Primitive;

use super::figure::{Canvas, Text};
use super::style;
use super::ticks::{format_tick, nice_step};

/// A value with its interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dot {
    /// The value. One that is not finite is not drawn.
    pub value: f64,
    /// The ends of the interval.
    pub interval: (f64, f64),
}

/// Named rows of values with intervals, on an axis through zero.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Dots {
    /// The kinds of values in a row, in order; each has a colour.
    pub kinds: Vec<String>,
    /// The rows from the top down: a name, and an optional value of each kind.
    pub rows: Vec<(String, Vec<Option<Dot>>)>,
    /// Name and unit of the axis below.
    pub label: String,
}

/// Distances between the values of a row, and between rows.
const LANE: f64 = 10.0;
const BETWEEN: f64 = 12.0;

/// Draws the rows as SVG.
pub fn dots(plot: &Dots) -> String {
    let finite = |dot: &&Dot| dot.value.is_finite() && dot.interval.0.is_finite() && dot.interval.1.is_finite();
    let all = || plot.rows.iter().flat_map(|(_, dots)| dots.iter().flatten()).filter(finite);
    let ends = || all().flat_map(|dot| [dot.value, dot.interval.0, dot.interval.1]);
    let (low, high) = (ends().fold(0.0, f64::min), ends().fold(0.0, f64::max));
    let (low, high) = if high > low { (low, high) } else { (-1.0, 1.0) };
    let names = plot.rows.iter().map(|(name, _)| style::text_width(name, style::LABEL_SIZE));
    let left = (names.fold(0.0, f64::max) + 24.0).min(360.0);
    let width = style::WIDTH - left - 24.0;
    let x = |value: f64| left + (value - low) / (high - low) * width;

    let mut canvas = Canvas::new(style::WIDTH);
    let colour = |kind: usize| style::CYCLE[kind % style::CYCLE.len()];
    let entries: Vec<LegendEntry> = plot
        .kinds
        .iter()
        .enumerate()
        .map(|(kind, name)| LegendEntry {
            label: name.clone(),
            color: colour(kind).into(),
            shape: LegendShape::Circle,
            dasharray: None,
        })
        .collect();
    let top = canvas.legend(&entries, left, 6.0);
    let row_height = plot.kinds.len().max(1) as f64 * LANE + BETWEEN;
    let bottom = top + plot.rows.len() as f64 * row_height;
    let step = nice_step((low, high), (width / 90.0).clamp(3.0, 8.0));
    let ticks = ((low / step).ceil() as i64..=(high / step).floor() as i64).map(|k| k as f64 * step);
    for tick in ticks {
        canvas.line((x(tick), top), (x(tick), bottom + 4.0), (style::GRID, 0.8, false));
        canvas.text(&format_tick(tick), x(tick), bottom + 17.0, Text::Middle);
    }
    canvas.line((x(0.0), top), (x(0.0), bottom), (style::AXIS, 1.4, false));
    for (row, (name, dots)) in plot.rows.iter().enumerate() {
        let first = top + row as f64 * row_height + BETWEEN / 2.0;
        canvas.text(name, left - 8.0, first + (row_height - BETWEEN) / 2.0 + 4.0, Text::End);
        for (kind, dot) in dots.iter().enumerate() {
            let Some(dot) = dot.as_ref().filter(finite) else { continue };
            let y = first + (kind as f64 + 0.5) * LANE;
            canvas.line((x(dot.interval.0), y), (x(dot.interval.1), y), (colour(kind), 1.6, false));
            canvas.scene.add(Primitive::Circle {
                cx: x(dot.value),
                cy: y,
                r: 3.5,
                fill: Color::from(colour(kind)),
                fill_opacity: None,
                stroke: None,
                stroke_width: None,
            });
        }
    }
    canvas.text(&plot.label, left + width / 2.0, bottom + 37.0, Text::Middle);
    canvas.finish(bottom + 46.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dot(value: f64, low: f64, high: f64) -> Option<Dot> {
        Some(Dot { value, interval: (low, high) })
    }

    fn plot(rows: Vec<(&str, Vec<Option<Dot>>)>) -> Dots {
        let rows = rows.into_iter().map(|(name, dots)| (name.to_owned(), dots)).collect();
        Dots { kinds: vec!["first".to_owned(), "second".to_owned()], rows, label: "change, %".to_owned() }
    }

    /// Returns the centres of the dots except those of the legend.
    fn centres(svg: &str) -> Vec<f64> {
        let parts = svg.split("cx=\"").skip(1 + 2);
        parts.filter_map(|part| part.split('"').next().and_then(|text| text.parse().ok())).collect()
    }

    #[test]
    fn places_go_with_the_values() {
        let svg = dots(&plot(vec![
            ("a", vec![dot(-10.0, -20.0, 0.0), dot(0.0, -5.0, 5.0)]),
            ("b", vec![None, dot(10.0, 0.0, 20.0)]),
        ]));
        let at = centres(&svg);
        assert_eq!(at.len(), 3, "{svg}");
        assert!(at[0] < at[1] && ((at[1] - at[0]) - (at[2] - at[1])).abs() < 0.05, "{at:?}");
    }

    #[test]
    fn odd_values_and_names_are_drawn_without_nonsense() {
        let nan = f64::NAN;
        for rows in [vec![], vec![("<script>", vec![dot(nan, 0.0, 1.0), dot(0.0, 0.0, 0.0)])]] {
            let svg = dots(&plot(rows));
            assert!(!svg.contains("NaN") && !svg.contains("inf") && !svg.contains("<script"), "{svg}");
            assert!(svg.contains("change, %"));
        }
    }
}
