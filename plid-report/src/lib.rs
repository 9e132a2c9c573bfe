//! Reports: plots as SVG strings, and a self-contained HTML page without scripts that contains them.
//!
//! Plots are drawn by `kuva` (0.6, without its optional features). It was chosen over `plotters` (0.3) for five
//! reasons: it keeps coordinates to a hundredth of a pixel, whereas the SVG of plotters rounds to whole pixels; it
//! combines markers and heat-map cells into one element each; it measures text without a system font; it escapes
//! text; and it clips to the axes. The module `figure` adds the features that it lacks: panels of different heights
//! on one page, a legend above the data, and names of clip paths that do not depend on what was drawn before.
//!
//! All output depends on the data only, and not on a clock or a counter of the process.

mod bars;
mod chart;
mod convergence_plot;
mod correlation_plot;
mod decimate;
mod dots;
mod figure;
mod frf_plot;
mod heat_map;
mod mode_map;
mod page;
mod panel;
mod style;
mod ticks;
mod trace_plot;
mod words;

pub use bars::{Bar, Bars, bars};
pub use chart::{Chart, chart, charts};
pub use convergence_plot::{ConvergencePlot, convergence_plot};
pub use correlation_plot::correlation_plot;
pub use dots::{Dot, Dots, dots};
pub use frf_plot::{FrfCurve, FrfPlot, frf_grid, frf_plot};
pub use heat_map::{HeatMap, heat_map};
pub use mode_map::{ModeSet, mode_map};
pub use page::{Cell, Report, Table};
pub use panel::{Axis, Scale, Series};
pub use plid_file::{file_name, write_atomic};
pub use trace_plot::{Trace, trace_plot};
pub use words::percent;
