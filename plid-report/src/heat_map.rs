use kuva::plot::ColorMap;
use kuva::render::color::Color;
use kuva::render::render::Primitive;
use ndarray::Array2;

use super::figure::{Canvas, Text};
use super::style;
use super::ticks::format_tick;

/// A table of numbers shown as colours.
#[derive(Debug, Clone, PartialEq)]
pub struct HeatMap {
    /// Names of the rows.
    pub rows: Vec<String>,
    /// Names of the columns.
    pub columns: Vec<String>,
    /// `rows x columns`; a cell that is not finite is left blank.
    pub values: Array2<f64>,
    /// Label of the columns, such as "band, Hz".
    pub column_label: String,
    /// Label of the colour scale with its unit.
    pub value_label: String,
    /// Ends of the colour scale. With `None`, it extends from zero, or from the least value if that is negative, to
    /// the largest value.
    pub range: Option<(f64, f64)>,
}

/// Least height of a row.
const CELL: f64 = 30.0;
const BAR: f64 = 14.0;
const TOP: f64 = 8.0;

/// Draws a heat map with its colour bar. Cells are labelled with their values if there is room.
pub fn heat_map(map: &HeatMap) -> String {
    let (rows, columns) = map.values.dim();
    let finite = || map.values.iter().copied().filter(|v| v.is_finite());
    let (low, high) = map.range.unwrap_or((finite().fold(0.0, f64::min), finite().fold(0.0, f64::max)));
    let share = |v: f64| {
        if high > low { ((v - low) / (high - low)).clamp(0.0, 1.0) } else { 0.0 }
    };

    let longest = map.rows.iter().map(|name| style::text_width(name, style::LABEL_SIZE)).fold(0.0, f64::max);
    let left = (longest + 24.0).min(300.0);
    let cell_width = (style::WIDTH - left - 110.0) / columns.max(1) as f64;
    let cell = cell_height(map);
    let bottom = TOP + rows as f64 * cell;
    let mut canvas = Canvas::new(style::WIDTH);
    for ((i, j), value) in map.values.indexed_iter() {
        let (x, y) = (left + j as f64 * cell_width, TOP + i as f64 * cell);
        let fill = if value.is_finite() { colour(share(*value)) } else { Color::from("#ffffff") };
        rectangle(&mut canvas, (x, y, cell_width, cell), fill);
        let text = if value.is_finite() { format_tick(rounded(*value)) } else { "–".into() };
        if style::text_width(&text, style::TICK_SIZE) < cell_width - 4.0 {
            let ink = if share(*value) > 0.55 || !value.is_finite() { "#111111" } else { "#ffffff" };
            canvas.scene.add(Primitive::Text {
                x: x + cell_width / 2.0,
                y: y + cell / 2.0 + 4.0,
                content: text,
                size: style::TICK_SIZE,
                anchor: kuva::render::render::TextAnchor::Middle,
                rotate: None,
                bold: false,
                color: Some(Color::from(ink)),
            });
        }
    }
    for (i, name) in map.rows.iter().take(rows).enumerate() {
        let name = style::fitted(name, style::LABEL_SIZE, left - 12.0);
        canvas.text(&name, left - 8.0, TOP + (i as f64 + 0.5) * cell + 4.0, Text::End);
    }
    // Names that would run into each other are thinned.
    let widest = map.columns.iter().map(|name| style::text_width(name, style::LABEL_SIZE)).fold(1.0, f64::max);
    let every = ((widest + 6.0) / cell_width).ceil().max(1.0) as usize;
    for (j, name) in map.columns.iter().take(columns).enumerate().step_by(every) {
        canvas.text(name, left + (j as f64 + 0.5) * cell_width, bottom + 17.0, Text::Middle);
    }
    canvas.text(&map.column_label, left + columns as f64 * cell_width / 2.0, bottom + 37.0, Text::Middle);
    colour_bar(&mut canvas, &map.value_label, (low, high), bottom);
    canvas.finish(bottom + 46.0)
}

/// Returns the height of a row. The label of the colour bar runs upwards beside all rows, and a few rows are higher so
/// that it fits.
fn cell_height(map: &HeatMap) -> f64 {
    let label = style::text_width(&map.value_label, style::LABEL_SIZE) + 4.0;
    CELL.max(label / map.values.nrows().max(1) as f64)
}

fn colour_bar(canvas: &mut Canvas, label: &str, range: (f64, f64), bottom: f64) {
    const STEPS: usize = 48;
    let x = style::WIDTH - 84.0;
    let step = (bottom - TOP) / STEPS as f64;
    for k in 0..STEPS {
        let share = 1.0 - (k as f64 + 0.5) / STEPS as f64;
        // Each step overlaps the next one, so that no light seam is visible between them.
        rectangle(canvas, (x, TOP + k as f64 * step, BAR, step + if k + 1 < STEPS { 0.5 } else { 0.0 }), colour(share));
    }
    let middle = 0.5 * (range.0 + range.1);
    let ends = [(range.1, TOP + 10.0), (range.0, bottom)];
    // A single row has no room between the ends.
    let between = (bottom - TOP > 1.5 * CELL).then_some((middle, 0.5 * (TOP + bottom) + 4.0));
    for (value, y) in ends.into_iter().chain(between) {
        canvas.text(&format_tick(rounded(value)), x + BAR + 5.0, y, Text::Start);
    }
    canvas.text(label, x - 8.0, 0.5 * (TOP + bottom), Text::Upwards);
}

fn rectangle(canvas: &mut Canvas, (x, y, width, height): (f64, f64, f64, f64), fill: Color) {
    canvas.scene.add(Primitive::Rect { x, y, width, height, fill, stroke: None, stroke_width: None, opacity: None });
}

fn colour(share: f64) -> Color {
    Color::from(ColorMap::Viridis.map(share).as_str())
}

/// Formats a number with two significant digits.
fn rounded(value: f64) -> f64 {
    format!("{value:.1e}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    fn map(values: Array2<f64>, names: usize) -> String {
        let name = |k: usize| format!("<{k}>");
        heat_map(&HeatMap {
            rows: (0..names).map(name).collect(),
            columns: (0..names).map(name).collect(),
            values,
            column_label: "band, Hz".into(),
            value_label: "gap".into(),
            range: None,
        })
    }

    #[test]
    fn the_ends_of_the_scale_have_the_ends_of_the_colours_and_gaps_none() {
        let svg = map(array![[0.0, 1.0], [f64::NAN, 0.5]], 2);
        let first = ColorMap::Viridis.map(0.0);
        let last = ColorMap::Viridis.map(1.0);
        let count = |colour: &str| {
            let mut hex = String::new();
            Color::from(colour).write_svg(&mut hex);
            svg.matches(&format!("fill=\"{hex}\"")).count()
        };
        assert!(count(&first) >= 1 && count(&last) >= 1);
        assert!(svg.contains(">–<") && svg.contains(">0.5<") && svg.contains("&lt;1&gt;"));
    }

    /// The label of the colour bar fits beside a single row.
    #[test]
    fn a_single_row_is_as_high_as_the_label_beside_it() {
        let labelled = |rows: usize, label: &str| {
            let (rows, values) = (vec![String::new(); rows], Array2::zeros((rows, 2)));
            let map = HeatMap {
                rows,
                values,
                columns: vec!["1".into(), "2".into()],
                column_label: "band, Hz".into(),
                value_label: label.into(),
                range: None,
            };
            cell_height(&map)
        };
        let label = "share of the squared gap, %";
        assert!(labelled(1, label) > style::text_width(label, style::LABEL_SIZE));
        assert_eq!((labelled(1, ""), labelled(20, label)), (CELL, CELL));
    }

    #[test]
    fn empty_and_constant_maps_are_drawn() {
        for values in [Array2::zeros((0, 0)), Array2::zeros((2, 2)), Array2::from_elem((1, 3), f64::NAN)] {
            let svg = map(values, 1);
            assert!(svg.starts_with("<svg") && !svg.contains("NaN") && !svg.contains("inf"));
        }
    }
}
