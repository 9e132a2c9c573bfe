use std::ops::Range;

use super::figure::single;
use super::panel::{Axis, Panel, Series};
use super::style;

/// The measured and computed samples of one output, from the first one of the window on.
#[derive(Debug, Clone, PartialEq)]
pub struct Trace<'a> {
    /// Name of the output.
    pub name: String,
    /// Its unit, such as "V".
    pub unit: String,
    /// Measured samples. A missing one is NaN.
    pub measured: &'a [f64],
    /// One-step predictions.
    pub predicted: Option<&'a [f64]>,
    /// Free-run simulation.
    pub free_run: Option<&'a [f64]>,
}

/// Returns "y1, V", or "y1" if the unit is not known.
fn with_unit(name: &str, unit: &str) -> String {
    if unit.is_empty() { name.to_string() } else { format!("{name}, {unit}") }
}

/// Plots measured, one-step predicted and free-run outputs over a window of samples, with the errors below each output.
/// The window counts samples from the start of the record.
pub fn trace_plot(traces: &[Trace], sample_rate_hz: f64, window: Range<usize>) -> String {
    let points = |values: &[f64]| -> Vec<(f64, f64)> {
        window.clone().zip(values).map(|(k, value)| (k as f64 / sample_rate_hz, *value)).collect()
    };
    let error =
        |measured: &[f64], other: &[f64]| points(&measured.iter().zip(other).map(|(y, x)| y - x).collect::<Vec<_>>());
    let last = window.end.max(window.start + 2) - 1;
    let x = Axis::linear("time, s").range(window.start as f64 / sample_rate_hz, last as f64 / sample_rate_hz);
    let mut panels = Vec::new();
    for trace in traces {
        let mut signals = vec![Series::line("measured", points(trace.measured)).colour(style::MEASURED).width(2.8)];
        let mut errors = Vec::new();
        let others = [
            ("free run", trace.free_run, style::FREE_RUN),
            ("one-step prediction", trace.predicted, style::IDENTIFIED),
        ];
        for (label, values, colour) in others {
            if let Some(values) = values {
                signals.push(Series::line(label, points(values)).colour(colour).width(1.2));
                errors.push(Series::line(label, error(trace.measured, values)).colour(colour).width(1.0));
            }
        }
        panels.push(Panel::new(x.clone(), Axis::linear(with_unit(&trace.name, &trace.unit)), 150.0, signals));
        if !errors.is_empty() {
            panels.push(Panel::new(x.clone(), Axis::linear(with_unit("error", &trace.unit)), 84.0, errors));
        }
    }
    single("", panels)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_short_predictions_and_windows_beyond_the_record_are_drawn() {
        let measured = [1.0, f64::NAN, 2.0, 3.0, f64::INFINITY];
        let trace = Trace {
            name: "y".into(),
            unit: "V".into(),
            measured: &measured,
            predicted: Some(&[1.1, 1.2]),
            free_run: None,
        };
        for window in [0..5, 3..900, 7..7] {
            let svg = trace_plot(std::slice::from_ref(&trace), 10.0, window);
            assert!(svg.contains("error, V") && svg.contains("one-step prediction") && !svg.contains("free run"));
            assert!(!svg.contains("NaN") && !svg.contains("inf"));
        }
    }
}
