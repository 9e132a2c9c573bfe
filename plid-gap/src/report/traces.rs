//! Traces and spectra of one output: measured, simulated as given, and simulated with the effects.

use std::ops::Range;

use ndarray::Array2;
use plid_model::signal::{WelchOptions, welch_spectra};
use plid_report::{Axis, Chart, Series, chart, charts};

use super::words::with;
use super::{GIVEN, MEASURED, REFERENCE, WITH};
use crate::case::record::{Channels, rms};
use crate::diagnose::Outcome;

/// Largest number of samples of a trace.
const WINDOW: usize = 200;

/// Returns the samples over which the outputs together are loudest, each in units of its RMS.
fn loudest(y: &[Vec<f64>]) -> Range<usize> {
    let samples = y.first().map_or(0, Vec::len);
    let finite = |y: &f64| if y.is_finite() { *y } else { 0.0 };
    let scale: Vec<f64> = y.iter().map(|y| 1.0 / rms(y.iter().filter(|y| y.is_finite())).max(1e-300)).collect();
    let mut sums = vec![0.0];
    for k in 0..samples {
        let now: f64 = y.iter().zip(&scale).map(|(y, s)| (finite(&y[k]) * s).powi(2)).sum();
        sums.push(sums[k] + now);
    }
    let width = WINDOW.min(samples);
    let within = |start: &usize| sums[start + width] - sums[*start];
    let start = (0..=samples - width).max_by(|a, b| within(a).total_cmp(&within(b))).unwrap_or(0);
    start..start + width
}

/// Outputs of one record: measured, simulated as given, and simulated with the effects.
pub(crate) struct Traces<'t> {
    /// Name of the record.
    pub record: &'t str,
    /// Sample rate in Hz.
    pub rate: f64,
    /// Names of the outputs (p).
    pub outputs: &'t [String],
    /// Unit of each output, if it is known.
    pub units: &'t [Option<String>],
    /// The outputs: measured, simulated as given, and simulated with the effects (p channels each).
    pub y: &'t [Channels; 3],
    /// Label of the simulation with the effects.
    pub with: String,
    /// For each output, pairs of a frequency in Hz and the density of the noise there; empty if the noise is not
    /// shown.
    pub noise: &'t [Vec<(f64, f64)>],
}

impl<'t> Traces<'t> {
    /// Returns the traces of a diagnosis.
    pub(super) fn of(outcome: &'t Outcome) -> Self {
        let shown = &outcome.shown;
        Self {
            record: &shown.trace_record,
            rate: shown.rate,
            outputs: &shown.outputs,
            units: &shown.units,
            y: &shown.trace,
            with: with(outcome).into(),
            noise: &shown.noise,
        }
    }
}

/// Returns the unit of output `o` for a label.
pub(super) fn unit(units: &[Option<String>], o: usize) -> &str {
    units.get(o).and_then(Option::as_deref).unwrap_or("as recorded")
}

/// Draws the loudest stretch of output `o`, with the errors below.
pub(crate) fn window(shown: &Traces, o: usize) -> String {
    let [measured, given, found] = shown.y;
    let unit = unit(shown.units, o);
    let range = loudest(measured);
    let points = |value: &dyn Fn(usize) -> f64| -> Vec<(f64, f64)> {
        range.clone().map(|k| (k as f64 / shown.rate, value(k))).collect()
    };
    let (y, as_given, with_it) = (&measured[o], &given[o], &found[o]);
    let ends = (range.start as f64 / shown.rate, (range.end.max(range.start + 2) - 1) as f64 / shown.rate);
    let x = Axis::linear(format!("time since {} began, s", shown.record)).range(ends.0, ends.1);
    let part = |label: String, height: f64, series: Vec<Series>| Chart {
        title: String::new(),
        x: x.clone(),
        y: Axis::linear(label),
        series,
        height,
    };
    charts(&[
        part(
            format!("{}, {unit}", shown.outputs[o]),
            170.0,
            vec![
                Series::line("measured", points(&|k| y[k])).colour(MEASURED).width(3.0),
                Series::line("as given", points(&|k| as_given[k])).colour(GIVEN).width(1.4),
                Series::line(shown.with.as_str(), points(&|k| with_it[k])).colour(WITH).width(1.4),
            ],
        ),
        part(
            format!("error, {unit}"),
            100.0,
            vec![
                Series::line("as given", points(&|k| y[k] - as_given[k])).colour(GIVEN).width(1.4),
                Series::line(shown.with.as_str(), points(&|k| y[k] - with_it[k])).colour(WITH).width(1.4),
            ],
        ),
    ])
}

/// Draws the spectra of output `o` and of its error, if the record is long enough.
pub(crate) fn spectra(shown: &Traces, o: usize) -> Option<String> {
    let [measured, given, found] = shown.y;
    let data = Array2::from_shape_fn((measured[o].len(), 3), |(k, which)| match which {
        0 => measured[o][k],
        1 => measured[o][k] - given[o][k],
        _ => measured[o][k] - found[o][k],
    });
    let options = WelchOptions { sample_rate_hz: shown.rate, segment_length: None };
    let spectra = welch_spectra(data.view(), &options).ok()?;
    let density = |which: usize| -> Vec<(f64, f64)> {
        let lines = spectra.frequency_hz.iter().enumerate().skip(1);
        lines.map(|(line, hz)| (*hz, spectra.density[[line, which, which]].re)).collect()
    };
    let noise = shown.noise.get(o).cloned().unwrap_or_default();
    Some(chart(&Chart {
        title: String::new(),
        x: Axis::linear("frequency, Hz").range(0.0, 0.5 * shown.rate),
        y: Axis::log(format!("density of {}, ({})²/Hz", shown.outputs[o], unit(shown.units, o))),
        series: vec![
            Series::line("measured", density(0)).colour(MEASURED).width(2.4),
            Series::line("error as given", density(1)).colour(GIVEN).width(1.6),
            Series::line(format!("error {}", shown.with), density(2)).colour(WITH).width(1.6),
            Series::line("noise alone", noise).colour(REFERENCE).width(1.4).dashed(),
        ],
        height: 240.0,
    }))
}

#[cfg(test)]
mod tests {
    use super::{loudest, unit};

    #[test]
    fn an_unknown_unit_is_that_of_the_record() {
        let units = [Some("rad/s".to_owned()), None];
        assert_eq!([0, 1, 2].map(|o| unit(&units, o)), ["rad/s", "as recorded", "as recorded"]);
    }

    #[test]
    fn the_loudest_moment_is_found_and_a_short_record_is_shown_whole() {
        let quiet = |k: usize| 0.1 * (k as f64).sin();
        let mut y: Vec<f64> = (0..2000).map(quiet).collect();
        (900..1000).for_each(|k| y[k] = 5.0);
        y[10] = f64::NAN;
        let found = loudest(&[y.clone(), vec![0.0; 2000]]);
        assert!(found.len() == 200 && found.start <= 900 && found.end >= 1000, "{found:?}");
        assert_eq!(loudest(&[y[..50].to_vec()]), 0..50);
        assert_eq!(loudest(&[Vec::new()]), 0..0);
    }
}
