use kuva::plot::{LegendEntry, LegendShape};
use kuva::render::color::Color;
use kuva::render::render::Primitive;

use super::figure::{Canvas, Text};
use super::style;
use super::ticks::{format_tick, nice_step};

/// One named bar.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Bar {
    /// The label on its left.
    pub name: String,
    /// Its length. A value that is negative or not finite is not drawn.
    pub value: f64,
    /// The label on its right, such as the value with its unit.
    pub text: String,
    /// The interval, drawn as a whisker.
    pub interval: Option<(f64, f64)>,
    /// Whether the bar is highlighted.
    pub strong: bool,
}

/// Named horizontal bars that start at zero.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Bars {
    /// The bars from the top down.
    pub bars: Vec<Bar>,
    /// Name and unit of the axis below, such as "gap, %".
    pub label: String,
    /// A reference value with its name, drawn across all bars as a dashed line.
    pub reference: Option<(String, f64)>,
}

const ROW: f64 = 26.0;
const BAR: f64 = 16.0;
const PLAIN: &str = "#9db7c9";

/// Draws bars as SVG.
pub fn bars(plot: &Bars) -> String {
    let widest = |texts: &mut dyn Iterator<Item = &String>| {
        texts.map(|text| style::text_width(text, style::LABEL_SIZE)).fold(0.0, f64::max)
    };
    let left = (widest(&mut plot.bars.iter().map(|bar| &bar.name)) + 24.0).min(360.0);
    let right = (widest(&mut plot.bars.iter().map(|bar| &bar.text)) + 24.0).min(300.0);
    let width = style::WIDTH - left - right;
    let ends = plot.bars.iter().flat_map(|bar| [bar.value, bar.interval.map_or(0.0, |(_, high)| high)]);
    let reference = plot.reference.as_ref().map(|(_, value)| *value);
    let most = ends.chain(reference).filter(|x| x.is_finite()).fold(0.0, f64::max);
    let most = if most > 0.0 { most } else { 1.0 };
    let x = |value: f64| left + value.clamp(0.0, most) / most * width;

    let mut canvas = Canvas::new(style::WIDTH);
    let entry = plot.reference.as_ref().filter(|(_, value)| value.is_finite()).map(|(name, _)| LegendEntry {
        label: name.clone(),
        color: style::REFERENCE.into(),
        shape: LegendShape::Line,
        dasharray: Some("6 4".into()),
    });
    let top = canvas.legend(entry.as_slice(), left, 6.0);
    let bottom = top + plot.bars.len() as f64 * ROW;
    let step = nice_step((0.0, most), (width / 90.0).clamp(3.0, 8.0));
    let ticks = (0..).map(|k| f64::from(k) * step).take_while(|tick| *tick <= most * (1.0 + 1e-9));
    for tick in ticks {
        canvas.line((x(tick), top), (x(tick), bottom + 4.0), (style::GRID, 0.8, false));
        canvas.text(&format_tick(tick), x(tick), bottom + 17.0, Text::Middle);
    }
    for (row, bar) in plot.bars.iter().enumerate() {
        let middle = top + (row as f64 + 0.5) * ROW;
        let end = x(if bar.value.is_finite() { bar.value } else { 0.0 });
        canvas.scene.add(Primitive::Rect {
            x: left,
            y: middle - BAR / 2.0,
            width: end - left,
            height: BAR,
            fill: Color::from(if bar.strong { style::IDENTIFIED } else { PLAIN }),
            stroke: None,
            stroke_width: None,
            opacity: None,
        });
        let mut reached = end;
        if let Some((low, high)) = bar.interval.filter(|(low, high)| low.is_finite() && high.is_finite()) {
            canvas.line((x(low), middle), (x(high), middle), (style::TEXT, 1.6, false));
            for at in [x(low), x(high)] {
                canvas.line((at, middle - 5.0), (at, middle + 5.0), (style::TEXT, 1.6, false));
            }
            reached = reached.max(x(high));
        }
        canvas.text(&style::fitted(&bar.name, style::LABEL_SIZE, left - 12.0), left - 8.0, middle + 4.0, Text::End);
        canvas.text(&bar.text, reached + 8.0, middle + 4.0, Text::Start);
    }
    canvas.line((left, top), (left, bottom), (style::AXIS, 1.0, false));
    if let Some(value) = reference.filter(|value| value.is_finite()) {
        canvas.line((x(value), top), (x(value), bottom), (style::REFERENCE, 1.6, true));
    }
    canvas.text(&plot.label, left + width / 2.0, bottom + 37.0, Text::Middle);
    canvas.finish(bottom + 46.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bar(name: &str, value: f64) -> Bar {
        Bar { name: name.into(), value, text: format!("{name} text"), ..Bar::default() }
    }

    /// Returns the widths of the bars.
    fn widths(svg: &str) -> Vec<f64> {
        let rectangles = svg.split("<rect ").skip(1).filter(|part| part.contains("height=\"16"));
        rectangles
            .map(|part| {
                let (_, rest) = part.split_once("width=\"").expect("a rectangle has a width");
                rest.split('"').next().and_then(|text| text.parse().ok()).expect("a number")
            })
            .collect()
    }

    #[test]
    fn lengths_go_with_the_values() {
        let svg = bars(&Bars { bars: vec![bar("a", 4.0), bar("b", 1.0), bar("c", 0.0)], ..Bars::default() });
        let widths = widths(&svg);
        assert_eq!(widths.len(), 3, "{svg}");
        assert!((widths[0] / widths[1] - 4.0).abs() < 0.01 && widths[2] == 0.0, "{widths:?}");
    }

    #[test]
    fn odd_values_and_names_are_drawn_without_nonsense() {
        let nan = f64::NAN;
        let mut odd = vec![bar("<script>", nan), bar("b", f64::INFINITY), bar("c", -1.0), bar("d", 0.0)];
        odd[1].interval = Some((nan, 1.0));
        for list in [odd, Vec::new()] {
            for reference in [None, Some(("floor".to_string(), nan)), Some(("floor".to_string(), 0.5))] {
                let svg = bars(&Bars { bars: list.clone(), label: "gap, %".into(), reference });
                assert!(!svg.contains("NaN") && !svg.contains("inf") && !svg.contains("<script"), "{svg}");
                assert!(svg.contains("gap, %"));
            }
        }
    }
}
