use kuva::backend::svg::SvgBackend;
use kuva::plot::{LegendEntry, LegendShape};
use kuva::render::color::Color;
use kuva::render::render::{Primitive, Scene, TextAnchor, render_multiple};

use super::panel::{Margins, Panel};
use super::style;

/// A column of panels that share their horizontal axis.
pub(super) struct Stack {
    pub title: String,
    pub panels: Vec<Panel>,
}

const LEFT: f64 = 66.0;
const LEFT_INNER: f64 = 46.0;
const RIGHT: f64 = 14.0;
const BETWEEN: f64 = 9.0;
const BELOW_TICKS: f64 = 22.0;
const BELOW_LABEL: f64 = 20.0;
const TITLE: f64 = 20.0;
const LEGEND_ROW: f64 = 20.0;

/// The prefix of clip path names, which a page with several figures makes distinct.
pub(super) const CLIP_PREFIX: &str = "plid-clip-";

/// Draws one stack of panels across the whole width.
pub(super) fn single(title: &str, panels: Vec<Panel>) -> String {
    grid(style::WIDTH, 1, vec![Stack { title: title.into(), panels }])
}

/// Draws stacks in rows of `columns`. Axes are labelled on the left and at the bottom only; the legend is above the
/// data.
pub(super) fn grid(width: f64, columns: usize, stacks: Vec<Stack>) -> String {
    let mut canvas = Canvas::new(width);
    let mut entries: Vec<LegendEntry> = Vec::new();
    for entry in stacks.iter().flat_map(|s| &s.panels).flat_map(Panel::legend) {
        if !entries.iter().any(|known| known.label == entry.label) {
            entries.push(entry);
        }
    }
    let mut y = canvas.legend(&entries, LEFT, 6.0);
    let columns = columns.max(1);
    let data_width = (width - LEFT - RIGHT - (columns - 1) as f64 * (LEFT_INNER + RIGHT)) / columns as f64;
    let rows: Vec<&[Stack]> = stacks.chunks(columns).collect();
    for (row, stacks_of_row) in rows.iter().enumerate() {
        let last_row = row + 1 == rows.len();
        let titled = stacks_of_row.iter().any(|s| !s.title.is_empty());
        let top = y + if titled { TITLE } else { 0.0 };
        let mut bottom = top;
        for (column, stack) in stacks_of_row.iter().enumerate() {
            let x = LEFT + column as f64 * (data_width + RIGHT + LEFT_INNER);
            canvas.text(&style::fitted(&stack.title, style::TITLE_SIZE, data_width + RIGHT), x, top - 5.0, Text::Title);
            let mut at = top;
            for (index, panel) in stack.panels.iter().enumerate() {
                let ticks = index + 1 == stack.panels.len();
                canvas.panel(panel, x, at, data_width, ticks);
                if column == 0 {
                    canvas.text(&panel.y.label, 14.0, at + panel.height / 2.0, Text::Upwards);
                }
                at += panel.height + if ticks { BELOW_TICKS } else { BETWEEN };
            }
            if let Some(panel) = stack.panels.last().filter(|_| last_row) {
                canvas.text(&panel.x.label, x + data_width / 2.0, at + 10.0, Text::Middle);
            }
            bottom = bottom.max(at);
        }
        y = bottom + if last_row { BELOW_LABEL } else { 6.0 };
    }
    canvas.finish(y)
}

/// The style of a text.
#[derive(Debug, Clone, Copy)]
pub(super) enum Text {
    Title,
    Start,
    Middle,
    End,
    Upwards,
}

/// A drawing that is extended downwards.
pub(super) struct Canvas {
    pub scene: Scene,
    clips: usize,
}

impl Canvas {
    pub fn new(width: f64) -> Self {
        let mut scene = Scene::new(width, 0.0);
        scene.font_family = Some(style::FONT.into());
        scene.text_color = Some(style::TEXT.into());
        Self { scene, clips: 0 }
    }

    /// Draws a panel with the corner of its data area at (x, y).
    fn panel(&mut self, panel: &Panel, x: f64, y: f64, width: f64, ticks: bool) {
        let margins = Margins { left: LEFT, right: RIGHT, top: BETWEEN, bottom: BELOW_TICKS };
        let (plots, layout) = panel.build(width, margins, ticks);
        self.place(render_multiple(plots, layout), x - margins.left, y - margins.top);
    }

    /// Places a finished scene at (x, y). The library numbers clip paths over the life of the process; here they are
    /// numbered within the figure.
    pub fn place(&mut self, part: Scene, x: f64, y: f64) {
        let ids: Vec<String> = part
            .elements
            .iter()
            .filter_map(|element| if let Primitive::ClipStart { id, .. } = element { Some(id.clone()) } else { None })
            .collect();
        let first = self.clips;
        self.clips += ids.len();
        let renamed = |id: &str| match ids.iter().position(|known| known == id) {
            Some(index) => format!("{CLIP_PREFIX}{}", first + index),
            None => id.to_string(),
        };
        for definition in part.defs {
            let known = ids.iter().find(|id| definition.contains(&format!("\"{id}\"")));
            self.scene.defs.push(match known {
                Some(id) => definition.replace(&format!("\"{id}\""), &format!("\"{}\"", renamed(id))),
                None => definition,
            });
        }
        self.scene.add(Primitive::GroupStart {
            transform: Some(format!("translate({x:.2},{y:.2})")),
            title: None,
            extra_attrs: None,
        });
        for element in part.elements {
            self.scene.add(match element {
                Primitive::ClipStart { x, y, width, height, id } => {
                    Primitive::ClipStart { x, y, width, height, id: renamed(&id) }
                }
                other => other,
            });
        }
        self.scene.add(Primitive::GroupEnd);
    }

    pub fn text(&mut self, text: &str, x: f64, y: f64, look: Text) {
        if text.is_empty() {
            return;
        }
        let (size, anchor, rotate, bold) = match look {
            Text::Title => (style::TITLE_SIZE, TextAnchor::Start, None, true),
            Text::Start => (style::LABEL_SIZE, TextAnchor::Start, None, false),
            Text::Middle => (style::LABEL_SIZE, TextAnchor::Middle, None, false),
            Text::End => (style::LABEL_SIZE, TextAnchor::End, None, false),
            Text::Upwards => (style::LABEL_SIZE, TextAnchor::Middle, Some(-90.0), false),
        };
        self.scene.add(Primitive::Text { x, y, content: text.into(), size, anchor, rotate, bold, color: None });
    }

    /// Draws a straight line with a colour and a width, dashed or solid.
    pub fn line(&mut self, from: (f64, f64), to: (f64, f64), (colour, width, dashed): (&str, f64, bool)) {
        self.scene.add(Primitive::Line {
            x1: from.0,
            y1: from.1,
            x2: to.0,
            y2: to.1,
            stroke: Color::from(colour),
            stroke_width: width,
            stroke_dasharray: dashed.then(|| "6 4".to_string()),
        });
    }

    /// Draws legend entries side by side from (x, y) in as many rows as needed, and returns the height reached.
    pub fn legend(&mut self, entries: &[LegendEntry], x: f64, y: f64) -> f64 {
        if entries.is_empty() {
            return y + 4.0;
        }
        let (mut at, mut row) = (x, y);
        for entry in entries {
            let width = 30.0 + style::text_width(&entry.label, style::LABEL_SIZE) + 14.0;
            if at > x && at + width > self.scene.width - RIGHT {
                at = x;
                row += LEGEND_ROW;
            }
            let middle = row + LEGEND_ROW / 2.0;
            let colour = Color::from(entry.color.as_str());
            self.scene.add(match entry.shape {
                LegendShape::Rect => Primitive::Rect {
                    x: at,
                    y: middle - 5.0,
                    width: 22.0,
                    height: 10.0,
                    fill: colour,
                    stroke: None,
                    stroke_width: None,
                    opacity: Some(0.4),
                },
                LegendShape::Line => Primitive::Line {
                    x1: at,
                    y1: middle,
                    x2: at + 22.0,
                    y2: middle,
                    stroke: colour,
                    stroke_width: 2.0,
                    stroke_dasharray: entry.dasharray.clone(),
                },
                _ => Primitive::Circle {
                    cx: at + 11.0,
                    cy: middle,
                    r: 3.5,
                    fill: colour,
                    fill_opacity: None,
                    stroke: None,
                    stroke_width: None,
                },
            });
            self.text(&entry.label, at + 28.0, middle + 4.0, Text::Start);
            at += width;
        }
        row + LEGEND_ROW + 6.0
    }

    /// Returns the SVG, with a view box so that a page can scale it.
    pub fn finish(mut self, height: f64) -> String {
        self.scene.height = height;
        let view = format!("<svg viewBox=\"0 0 {:.2} {height:.2}\" ", self.scene.width);
        SvgBackend::new().render_scene(&self.scene).replacen("<svg ", &view, 1)
    }
}
