use kuva::plot::{BandPlot, LegendEntry, LegendShape, LinePlot, LineStyle, ScatterPlot};
use kuva::render::layout::Layout;
use kuva::render::plots::Plot;
use kuva::render::theme::Theme;

use super::decimate::{decimate, thin_points};
use super::style;
use super::ticks::{drawing_factor, nice_step, tick_format};

/// The scale of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Scale {
    /// A linear scale.
    #[default]
    Linear,
    /// A logarithmic scale; values that are not positive are left out.
    Log,
}

/// One axis of a plot.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Axis {
    /// Name and unit, as in "frequency, Hz".
    pub label: String,
    /// Linear or logarithmic.
    pub scale: Scale,
    /// The ends of the axis. With `None`, they are those of the data with a margin.
    pub range: Option<(f64, f64)>,
    /// Distance between ticks. With `None`, it is a round number.
    pub step: Option<f64>,
}

impl Axis {
    /// Creates a linear axis over the range of the data.
    pub fn linear(label: impl Into<String>) -> Self {
        Self { label: label.into(), ..Self::default() }
    }

    /// Creates a logarithmic axis over the range of the data.
    pub fn log(label: impl Into<String>) -> Self {
        Self { label: label.into(), scale: Scale::Log, ..Self::default() }
    }

    /// Sets the ends of the axis.
    pub fn range(mut self, from: f64, to: f64) -> Self {
        self.range = Some((from, to));
        self
    }

    /// Places the ticks at multiples of `step`.
    pub fn step(mut self, step: f64) -> Self {
        self.step = Some(step);
        self
    }

    fn forward(&self, value: f64) -> f64 {
        match self.scale {
            Scale::Linear => value,
            Scale::Log => value.log10(),
        }
    }

    /// Limits a range to 40 decades and to representable numbers.
    fn drawable(&self, (low, high): (f64, f64)) -> (f64, f64) {
        const LARGEST: f64 = 1e290;
        match self.scale {
            Scale::Linear => (low.max(-LARGEST), high.min(LARGEST)),
            Scale::Log => (low.max(1e-40 * high.min(LARGEST)), high.min(LARGEST)),
        }
    }

    fn resolved(&self, values: impl Iterator<Item = f64>, room: f64) -> (f64, f64) {
        let given = self
            .range
            .map(|range| self.drawable(range))
            .filter(|(from, to)| self.forward(*from).is_finite() && self.forward(*to).is_finite() && from < to);
        if let Some(range) = given {
            return range;
        }
        let (low, high) = values
            .filter(|v| v.is_finite() && self.forward(*v).is_finite())
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        let range = match self.scale {
            _ if low > high => (if self.scale == Scale::Log { 0.1 } else { 0.0 }, 1.0),
            Scale::Linear if high - low <= 1e-12 * high.abs().max(low.abs()) => {
                let half = if high == 0.0 { 1.0 } else { 0.1 * high.abs() };
                (low - half, high + half)
            }
            Scale::Linear => (low - room * (high - low), high + room * (high - low)),
            Scale::Log => {
                let factor = (high / low).powf(room).clamp(1.02, 1e3);
                (low / factor, high * factor)
            }
        };
        self.drawable(range)
    }
}

#[derive(Debug, Clone, PartialEq)]
enum Shape {
    Line(Vec<(f64, f64)>),
    Points(Vec<(f64, f64)>),
    Stems(Vec<(f64, f64)>),
    Area(Vec<(f64, f64)>),
    Band(Vec<(f64, f64, f64)>),
    Level(f64),
    Vertical(f64),
}

/// One series of a plot, with its entry in the legend.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    label: String,
    shape: Shape,
    colour: Option<String>,
    width: f64,
    dashed: bool,
}

impl Series {
    fn new(label: impl Into<String>, shape: Shape) -> Self {
        Self { label: label.into(), shape, colour: None, width: style::LINE, dashed: false }
    }

    /// Creates a line through the points. A point that is not finite is a gap. An empty label keeps a series out of
    /// the legend.
    pub fn line(label: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Self::new(label, Shape::Line(points))
    }

    /// Creates vertical lines from low to high at each (x, low, high), without a legend entry, for the intervals of
    /// markers.
    pub fn whiskers(intervals: impl IntoIterator<Item = (f64, f64, f64)>) -> Self {
        let one = |(x, low, high): (f64, f64, f64)| [(x, low), (x, high), (x, f64::NAN)];
        Self::line("", intervals.into_iter().flat_map(one).collect()).width(2.0)
    }

    /// Creates markers.
    pub fn points(label: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Self::new(label, Shape::Points(points)).width(3.0)
    }

    /// Creates a thin bar from zero to each point.
    pub fn stems(label: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Self::new(label, Shape::Stems(points))
    }

    /// Creates the area between zero and the points.
    pub fn area(label: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Self::new(label, Shape::Area(points))
    }

    /// Creates a band over (x, low, high).
    pub fn band(label: impl Into<String>, points: Vec<(f64, f64, f64)>) -> Self {
        Self::new(label, Shape::Band(points))
    }

    /// Creates a dashed horizontal line across the plot.
    pub fn level(label: impl Into<String>, value: f64) -> Self {
        Self::new(label, Shape::Level(value)).dashed()
    }

    /// Creates a dashed vertical line across the plot.
    pub fn vertical(label: impl Into<String>, value: f64) -> Self {
        Self::new(label, Shape::Vertical(value)).dashed()
    }

    /// Sets the colour (CSS) instead of the next one of the palette.
    pub fn colour(mut self, colour: &str) -> Self {
        self.colour = Some(colour.into());
        self
    }

    /// Sets the line width, or the radius of markers, in pixels.
    pub fn width(mut self, width: f64) -> Self {
        self.width = width;
        self
    }

    /// Makes the line dashed.
    pub fn dashed(mut self) -> Self {
        self.dashed = true;
        self
    }

    fn xs(&self) -> Vec<f64> {
        match &self.shape {
            Shape::Line(p) | Shape::Points(p) | Shape::Stems(p) | Shape::Area(p) => p.iter().map(|p| p.0).collect(),
            Shape::Band(p) => p.iter().map(|p| p.0).collect(),
            Shape::Vertical(x) => vec![*x],
            Shape::Level(_) => vec![],
        }
    }

    fn ys(&self) -> Vec<f64> {
        match &self.shape {
            Shape::Line(p) | Shape::Points(p) => p.iter().map(|p| p.1).collect(),
            Shape::Stems(p) | Shape::Area(p) => p.iter().map(|p| p.1).chain([0.0]).collect(),
            Shape::Band(p) => p.iter().flat_map(|p| [p.1, p.2]).collect(),
            Shape::Level(y) => vec![*y],
            Shape::Vertical(_) => vec![],
        }
    }
}

/// One pair of axes with its series. Later series are drawn above earlier ones.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Panel {
    pub x: Axis,
    pub y: Axis,
    pub series: Vec<Series>,
    /// Height of the data area in pixels.
    pub height: f64,
    /// Whether the vertical axis has tick labels.
    pub y_ticks: bool,
}

/// Pixels around the data area.
#[derive(Debug, Clone, Copy)]
pub(super) struct Margins {
    pub left: f64,
    pub right: f64,
    pub top: f64,
    pub bottom: f64,
}

impl Panel {
    pub fn new(x: Axis, y: Axis, height: f64, series: Vec<Series>) -> Self {
        // Series receive colours in the order in which they are given, whatever lies between them.
        let mut free = style::CYCLE.iter().cycle();
        let series = series
            .into_iter()
            .map(|mut s| {
                if s.colour.is_none() {
                    s.colour = free.next().map(ToString::to_string);
                }
                s
            })
            .collect();
        Self { x, y, series, height, y_ticks: true }
    }

    /// The legend entry of this panel.
    pub fn legend(&self) -> Vec<LegendEntry> {
        let entry = |s: &Series| LegendEntry {
            label: s.label.clone(),
            color: s.colour.clone().unwrap_or_default(),
            shape: match s.shape {
                Shape::Points(_) => LegendShape::Circle,
                Shape::Band(_) | Shape::Area(_) => LegendShape::Rect,
                _ => LegendShape::Line,
            },
            dasharray: s.dashed.then(|| "6 4".to_string()),
        };
        self.series.iter().filter(|s| !s.label.is_empty()).map(entry).collect()
    }

    /// Returns the library's plots and layout for a data area of `width` pixels; `x_ticks` says whether the horizontal
    /// axis has tick labels.
    pub fn build(&self, width: f64, margins: Margins, x_ticks: bool) -> (Vec<Plot>, Layout) {
        let x_range = self.x.resolved(self.series.iter().flat_map(Series::xs), 0.0);
        let y_range = self.y.resolved(self.series.iter().flat_map(Series::ys), 0.06);
        let (fx, fy) = (drawing_factor(self.x.scale, x_range), drawing_factor(self.y.scale, y_range));
        let view = View { panel: self, x_range, y_range, width, fx, fy };
        let mut plots: Vec<Plot> = self.series.iter().flat_map(|s| view.draw(s)).collect();
        if plots.is_empty() {
            // Without any plot the library draws no axes.
            plots.push(Plot::Line(LinePlot::new().with_data([(x_range.0 * fx, y_range.0 * fy)])));
        }

        let scaled = |range: (f64, f64), factor: f64| (range.0 * factor, range.1 * factor);
        // The number of decades that share one label.
        let every = |axis: &Axis, range: (f64, f64), texts: f64| match axis.scale {
            Scale::Linear => 1,
            Scale::Log => ((range.1 / range.0).log10() / texts).ceil() as i32,
        };
        let (xs, ys) = (scaled(x_range, fx), scaled(y_range, fy));
        let mut layout = Layout::new(xs, ys)
            .with_width(width + margins.left + margins.right)
            .with_height(self.height + margins.top + margins.bottom)
            .with_force_margins(margins.left, margins.right)
            .with_force_margins_y(margins.top, margins.bottom)
            .with_x_axis_min(xs.0)
            .with_x_axis_max(xs.1)
            .with_y_axis_min(ys.0)
            .with_y_axis_max(ys.1)
            .with_tick_size(style::TICK_SIZE)
            .with_box_axes()
            .with_tick_length(4.0)
            .with_axis_line_width(0.8)
            .with_tick_width(0.8)
            .with_grid_line_width(0.8)
            .with_x_tick_format(tick_format(fx, every(&self.x, x_range, width / 45.0)))
            .with_y_tick_format(tick_format(fy, every(&self.y, y_range, self.height / 20.0)))
            .with_theme(theme());
        layout.show_legend = false;
        layout.suppress_x_ticks = !x_ticks;
        layout.suppress_y_ticks = !self.y_ticks;
        if self.x.scale == Scale::Log {
            layout = layout.with_log_x();
        }
        if self.y.scale == Scale::Log {
            layout = layout.with_log_y();
        }
        // The library marks decades well, but a logarithmic axis of less than one decade has no ticks.
        let step = |axis: &Axis, range: (f64, f64), count: f64| match axis.scale {
            Scale::Log if range.1 / range.0 > 8.0 => None,
            _ => Some(axis.step.unwrap_or_else(|| nice_step(range, count))),
        };
        if let Some(step) = step(&self.x, x_range, (width / 70.0).clamp(3.0, 10.0)) {
            layout = layout.with_x_tick_step(step * fx);
        }
        if let Some(step) = step(&self.y, y_range, (self.height / 32.0).clamp(2.5, 8.0)) {
            layout = layout.with_y_tick_step(step * fy);
        }
        (plots, layout)
    }
}

fn theme() -> Theme {
    Theme {
        axis_color: style::AXIS.into(),
        tick_color: style::AXIS.into(),
        grid_color: style::GRID.into(),
        text_color: style::TEXT.into(),
        font_family: Some(style::FONT.into()),
        ..Theme::light()
    }
}

/// A panel with its final ranges and size.
struct View<'a> {
    panel: &'a Panel,
    x_range: (f64, f64),
    y_range: (f64, f64),
    width: f64,
    fx: f64,
    fy: f64,
}

impl View<'_> {
    fn column(&self, x: f64) -> f64 {
        let axis = &self.panel.x;
        let (from, to) = (axis.forward(self.x_range.0), axis.forward(self.x_range.1));
        (axis.forward(x) - from) / (to - from) * self.width
    }

    fn row(&self, y: f64) -> f64 {
        let axis = &self.panel.y;
        let (from, to) = (axis.forward(self.y_range.0), axis.forward(self.y_range.1));
        (axis.forward(y) - from) / (to - from) * self.panel.height
    }

    /// Returns the points to draw: those inside the horizontal range and one on each side, with far values limited to
    /// what SVG can represent.
    fn prepare(&self, points: &[(f64, f64)]) -> Vec<(f64, f64)> {
        let inside = |x: f64| x >= self.x_range.0 && x <= self.x_range.1;
        let near = |k: usize| points.get(k).is_some_and(|p| inside(p.0));
        (0..points.len())
            .filter(|&k| near(k) || near(k + 1) || (k > 0 && near(k - 1)))
            .map(|k| (points[k].0, self.tame(points[k].1)))
            .collect()
    }

    fn tame(&self, y: f64) -> f64 {
        let axis = &self.panel.y;
        if y == f64::INFINITY || self.row(y) > 10.0 * self.panel.height {
            return match axis.scale {
                Scale::Linear => self.y_range.1 + 5.0 * (self.y_range.1 - self.y_range.0),
                Scale::Log => self.y_range.1 * (self.y_range.1 / self.y_range.0).powi(2),
            };
        }
        if axis.scale == Scale::Linear && self.row(y) < -10.0 * self.panel.height {
            return self.y_range.0 - 5.0 * (self.y_range.1 - self.y_range.0);
        }
        // A logarithmic axis cannot show values at or below zero.
        if axis.scale == Scale::Log && y <= 0.0 { f64::NAN } else { y }
    }

    fn scaled(&self, points: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
        points.into_iter().map(|(x, y)| (x * self.fx, y * self.fy)).collect()
    }

    fn line(&self, points: &[(f64, f64)], series: &Series, fill: bool) -> Vec<Plot> {
        let colour = series.colour.clone().unwrap_or_default();
        let runs = decimate(&self.prepare(points), self.width, |x| self.column(x));
        let draw = |run: Vec<(f64, f64)>| {
            let mut line = LinePlot::new()
                .with_data(self.scaled(run))
                .with_color(colour.clone())
                .with_stroke_width(series.width)
                .with_line_style(if series.dashed { LineStyle::Custom("6 4".into()) } else { LineStyle::Solid });
            if fill {
                line = line.with_fill().with_fill_opacity(0.35);
            }
            Plot::Line(line)
        };
        runs.into_iter().map(draw).collect()
    }

    fn draw(&self, series: &Series) -> Vec<Plot> {
        let colour = series.colour.clone().unwrap_or_default();
        match &series.shape {
            Shape::Line(points) => self.line(points, series, false),
            Shape::Area(points) => self.line(points, series, true),
            Shape::Level(y) => self.line(&[(self.x_range.0, *y), (self.x_range.1, *y)], series, false),
            Shape::Vertical(x) => self.line(&[(*x, self.y_range.0), (*x, self.y_range.1)], series, false),
            Shape::Stems(points) => {
                points.iter().flat_map(|&(x, y)| self.line(&[(x, 0.0), (x, y)], series, false)).collect()
            }
            Shape::Points(points) => {
                let kept = thin_points(points, |x, y| (self.column(x), self.row(y)));
                if kept.is_empty() {
                    return vec![];
                }
                vec![Plot::Scatter(
                    ScatterPlot::new().with_data(self.scaled(kept)).with_color(colour).with_size(series.width),
                )]
            }
            Shape::Band(points) => {
                let low = |y: f64| {
                    if self.panel.y.scale == Scale::Log && y <= 0.0 { self.y_range.0 } else { self.tame(y) }
                };
                let kept: Vec<(f64, f64, f64)> = points.iter().map(|&(x, l, h)| (x, low(l), self.tame(h))).collect();
                kept.split(|(x, l, h)| !(l.is_finite() && h.is_finite() && self.column(*x).is_finite()))
                    .filter(|run| run.len() > 1)
                    .map(|run| {
                        let band = BandPlot::new(
                            run.iter().map(|p| p.0 * self.fx),
                            run.iter().map(|p| p.1 * self.fy),
                            run.iter().map(|p| p.2 * self.fy),
                        );
                        Plot::Band(band.with_color(colour.clone()).with_opacity(style::BAND_OPACITY))
                    })
                    .collect()
            }
        }
    }
}
