use num_complex::Complex64;

use super::figure::{Stack, grid, single};
use super::panel::{Axis, Panel, Scale, Series};
use super::style;

/// One frequency response of one input-output pair.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FrfCurve {
    /// Frequencies in Hz in increasing order.
    pub frequency_hz: Vec<f64>,
    /// Response at each frequency.
    pub response: Vec<Complex64>,
    /// Standard deviation of |H| at each frequency; a band of two of them is drawn.
    pub std: Option<Vec<f64>>,
}

/// The curves of one input-output pair.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FrfPlot {
    /// The title, such as "u1 to y2".
    pub title: String,
    /// Unit of |H| at 0 dB, such as "V/V".
    pub unit: String,
    /// The measured response.
    pub measured: Option<FrfCurve>,
    /// Coherence at the frequencies of the measured response.
    pub coherence: Option<Vec<f64>>,
    /// The identified model.
    pub identified: Option<FrfCurve>,
    /// Further models by name, each in its own colour.
    pub others: Vec<(String, FrfCurve)>,
    /// The true model, if known.
    pub truth: Option<FrfCurve>,
    /// Frequencies in Hz at which the identified model is marked.
    pub peaks_hz: Vec<f64>,
    /// Linear or logarithmic frequency.
    pub frequency_scale: Scale,
    /// The frequency range in Hz; `None` for all.
    pub range_hz: Option<(f64, f64)>,
}

/// Depth of the magnitude plot below its highest point in dB.
const DEEPEST: f64 = 100.0;

/// Plots coherence, magnitude in dB and phase against frequency, from the top down.
pub fn frf_plot(plot: &FrfPlot) -> String {
    single(&plot.title, panels(plot, [46.0, 270.0, 110.0]))
}

/// Plots several pairs in rows of `columns`, one column per input and one row per output.
pub fn frf_grid(columns: usize, plots: &[FrfPlot]) -> String {
    let stack = |plot: &FrfPlot| {
        let mut panels = panels(plot, [18.0, 120.0, 56.0]);
        if plot.coherence.is_some() && plot.measured.is_some() {
            // The panel is too low for ticks. Its full height is a coherence of one.
            panels[0].y_ticks = false;
            panels[0].y.label = String::new();
        }
        Stack { title: plot.title.clone(), panels }
    };
    let width = style::WIDTH.max(230.0 * columns as f64);
    grid(width, columns, plots.iter().map(stack).collect())
}

fn panels(plot: &FrfPlot, heights: [f64; 3]) -> Vec<Panel> {
    let curves = [&plot.measured, &plot.truth, &plot.identified];
    let shown = curves.into_iter().flatten().chain(plot.others.iter().map(|(_, curve)| curve));
    let ends = shown.clone().flat_map(|c| c.frequency_hz.iter().copied()).filter(|f| *f > 0.0);
    let (low, high) =
        plot.range_hz.unwrap_or_else(|| ends.fold((f64::INFINITY, 0.0), |(l, h), f| (f.min(l), f.max(h))));
    let x = Axis { label: "frequency, Hz".into(), scale: plot.frequency_scale, range: Some((low, high)), step: None };

    let levels: Vec<f64> = shown
        .flat_map(|c| {
            c.frequency_hz
                .iter()
                .zip(&c.response)
                .filter(|(f, _)| (low..=high).contains(*f))
                .map(|(_, h)| decibel(h.norm()))
        })
        .filter(|level| level.is_finite())
        .collect();
    let top = levels.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let bottom = levels.iter().copied().fold(f64::INFINITY, f64::min).max(top - DEEPEST);
    let mut magnitude =
        Axis::linear(if plot.unit.is_empty() { "|H|, dB".into() } else { format!("|H|, dB re {}", plot.unit) });
    if top > bottom {
        let room = 0.06 * (top - bottom);
        magnitude = magnitude.range(bottom - room, top + room);
    }

    let mut panels = Vec::new();
    if let (Some(measured), Some(coherence)) = (&plot.measured, &plot.coherence) {
        let points = measured.frequency_hz.iter().copied().zip(coherence.iter().copied()).collect();
        let area = Series::area("coherence", points).colour(style::COHERENCE).width(1.0);
        panels.push(Panel::new(x.clone(), Axis::linear("γ²").range(0.0, 1.05).step(0.5), heights[0], vec![area]));
    }
    panels.push(Panel::new(x.clone(), magnitude, heights[1], magnitudes(plot)));
    let phase = Axis::linear("phase, °").range(-190.0, 190.0).step(if heights[2] > 80.0 { 90.0 } else { 180.0 });
    panels.push(Panel::new(x, phase, heights[2], phases(plot)));
    panels
}

fn magnitudes(plot: &FrfPlot) -> Vec<Series> {
    let level = |c: &FrfCurve| c.frequency_hz.iter().zip(&c.response).map(|(f, h)| (*f, decibel(h.norm()))).collect();
    let band = |c: &FrfCurve, std: &[f64]| {
        let around = |((f, h), s): ((&f64, &Complex64), &f64)| {
            (*f, decibel((h.norm() - 2.0 * s).max(0.0)), decibel(h.norm() + 2.0 * s))
        };
        c.frequency_hz.iter().zip(&c.response).zip(std).map(around).collect()
    };
    let mut series = Vec::new();
    if let Some(measured) = &plot.measured {
        series.push(Series::line("measured", level(measured)).colour(style::MEASURED).width(2.6));
    }
    if let Some(identified) = &plot.identified {
        if let Some(std) = &identified.std {
            series.push(Series::band("identified ± 2 std", band(identified, std)).colour(style::IDENTIFIED));
        }
        series.push(Series::line("identified", level(identified)).colour(style::IDENTIFIED).width(1.5));
    }
    for ((name, curve), colour) in plot.others.iter().zip(other_colours()) {
        if let Some(std) = &curve.std {
            series.push(Series::band(format!("{name} ± 2 std"), band(curve, std)).colour(colour));
        }
        series.push(Series::line(name.clone(), level(curve)).colour(colour).width(1.3));
    }
    if let Some(truth) = &plot.truth {
        series.push(Series::line("true", level(truth)).colour(style::TRUE_MODEL).width(1.1).dashed());
    }
    if let Some(identified) = plot.identified.as_ref().filter(|_| !plot.peaks_hz.is_empty()) {
        let nearest = |peak: &f64| {
            let distance = |k: &usize| (identified.frequency_hz[*k] - peak).abs();
            let k = (0..identified.frequency_hz.len()).min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
            Some((identified.frequency_hz[k], decibel(identified.response.get(k)?.norm())))
        };
        series.push(
            Series::points("modes", plot.peaks_hz.iter().filter_map(nearest).collect()).colour(style::TRUE_MODEL),
        );
    }
    series
}

/// Colours of the further models, which differ from those of the other curves.
fn other_colours() -> impl Iterator<Item = &'static str> {
    let taken = [style::MEASURED, style::IDENTIFIED, style::TRUE_MODEL];
    style::CYCLE.into_iter().filter(move |colour| !taken.contains(colour)).cycle()
}

fn phases(plot: &FrfPlot) -> Vec<Series> {
    let models = plot.others.iter().zip(other_colours()).map(|((_, curve), colour)| (curve, colour, 1.1));
    let measured = plot.measured.iter().map(|curve| (curve, style::MEASURED, 1.8));
    let identified = plot.identified.iter().map(|curve| (curve, style::IDENTIFIED, 1.3));
    let mut series: Vec<Series> = measured
        .chain(identified)
        .chain(models)
        .map(|(curve, colour, width)| Series::line("", phase_points(curve)).colour(colour).width(width))
        .collect();
    if let Some(truth) = &plot.truth {
        series.push(Series::line("", phase_points(truth)).colour(style::TRUE_MODEL).width(1.0).dashed());
    }
    series
}

/// Returns the phase in degrees with a gap at each wrap.
fn phase_points(curve: &FrfCurve) -> Vec<(f64, f64)> {
    let mut points: Vec<(f64, f64)> = Vec::new();
    for (f, h) in curve.frequency_hz.iter().zip(&curve.response) {
        let phase = h.arg().to_degrees();
        if points.last().is_some_and(|last| (last.1 - phase).abs() > 180.0) {
            points.push((*f, f64::NAN));
        }
        points.push((*f, phase));
    }
    points
}

fn decibel(value: f64) -> f64 {
    20.0 * value.log10()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_phase_is_cut_where_it_wraps() {
        let response = [170.0, 179.0, -179.0, -170.0].map(|d: f64| Complex64::from_polar(1.0, d.to_radians()));
        let curve = FrfCurve { frequency_hz: vec![1.0, 2.0, 3.0, 4.0], response: response.to_vec(), std: None };
        let points = phase_points(&curve);
        assert_eq!(points.len(), 5);
        assert!(points[2].1.is_nan() && (points[3].1 + 179.0).abs() < 1e-9);
    }

    #[test]
    fn a_zero_of_the_response_and_an_empty_plot_are_drawn() {
        let curve = FrfCurve {
            frequency_hz: vec![1.0, 2.0, 3.0],
            response: vec![Complex64::ONE, Complex64::ZERO, Complex64::ONE],
            std: Some(vec![0.1, 0.6, f64::NAN]),
        };
        let plot = FrfPlot { identified: Some(curve), peaks_hz: vec![2.9], ..Default::default() };
        for svg in [frf_plot(&plot), frf_plot(&FrfPlot::default()), frf_grid(2, &[plot.clone(), plot.clone()])] {
            assert!(!svg.contains("NaN") && !svg.contains("inf"));
        }
    }
}
