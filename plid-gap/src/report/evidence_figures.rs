//! Figures of the evidence that does not enter the verdict.

use plid_report::{Axis, Chart, Report, Series, chart, charts};

use super::traces::unit;
use super::words::{with, worst};
use super::{MEASURED, REFERENCE};
use crate::diagnose::Outcome;
use crate::evidence::lines::{Kind, Line, Lines};
use crate::evidence::resonances::{Alone, Resonance, by_trend};
use crate::evidence::trend::Along;
use crate::plant::plain_hz;
use crate::settings::GapSettings;

/// Largest number of resonances in a figure.
const MODES: usize = 4;

/// Adds each of the two figures for which there are data.
pub(super) fn section(mut report: Report, outcome: &Outcome) -> Report {
    let evidence = &outcome.shown.evidence;
    if let Some((svg, along)) = resonances(&evidence.resonances, &outcome.diagnosis.settings) {
        report = report.figure(
            svg,
            format!(
                "Resonances relative to their mean, from a linear model fitted to each record separately, against {}. \
                Whiskers: two standard deviations. The {MODES} resonances, at most, that move most clearly.",
                match along {
                    Along::Level => "the level",
                    Along::Time => "time",
                }
            ),
        );
    }
    if let Some(lines) = &evidence.lines {
        report = report.figure(
            left_out(lines, outcome),
            format!(
                "Lines of {} at {}: driven lines, and the residual of the linear simulation at the others. There, a \
                linear structure shows only noise; an odd nonlinearity responds at odd lines, an even one at even \
                lines. Curves: the simulation {}.",
                lines.record,
                outcome.shown.outputs[worst(outcome)],
                with(outcome)
            ),
        );
    }
    report
}

fn resonances(alone: &[Alone], settings: &GapSettings) -> Option<(String, Along)> {
    let trends = by_trend(alone, settings);
    let along = trends.first()?.1.with;
    let x = |alone: &Alone| match along {
        Along::Level => alone.level,
        Along::Time => alone.start_s,
    };
    let picture = |label: &str, height: f64, value: &dyn Fn(&Resonance) -> (f64, f64)| {
        let mut series = Vec::new();
        for (&(mode, _), colour) in trends.iter().take(MODES).zip(COLOURS) {
            let mut seen: Vec<(f64, Resonance)> = alone.iter().filter_map(|a| Some((x(a), a.modes[mode]?))).collect();
            seen.sort_by(|a, b| a.0.total_cmp(&b.0));
            let mean = seen.iter().map(|(_, r)| value(r).0).sum::<f64>() / seen.len() as f64;
            let hz = seen.iter().map(|(_, r)| r.hz).sum::<f64>() / seen.len() as f64;
            let at = |r: &Resonance, by: f64| 100.0 * ((value(r).0 + by * value(r).1) / mean - 1.0);
            let points: Vec<(f64, f64)> = seen.iter().map(|(x, r)| (*x, at(r, 0.0))).collect();
            series.push(Series::line("", points.clone()).colour(colour));
            let intervals = seen.iter().map(|(x, r)| (*x, at(r, -2.0), at(r, 2.0)));
            series.push(Series::whiskers(intervals).colour(colour));
            series.push(Series::points(format!("{} Hz", plain_hz(hz)), points).colour(colour).width(4.0));
        }
        let name = match along {
            Along::Level => "level: RMS of the inputs, as recorded",
            Along::Time => "start of the record, s",
        };
        let ends = || alone.iter().map(x);
        let (first, last) = (ends().fold(f64::INFINITY, f64::min), ends().fold(f64::NEG_INFINITY, f64::max));
        let room = 0.03 * (last - first);
        Chart {
            title: String::new(),
            x: Axis::linear(name).range(first - room, last + room),
            y: Axis::linear(label),
            series,
            height,
        }
    };
    let frequency = picture("frequency, %", 150.0, &|r| (r.hz, r.hz_std));
    let damping = picture("damping ratio, %", 110.0, &|r| (r.damping, r.damping_std));
    Some((charts(&[frequency, damping]), along))
}

const COLOURS: [&str; MODES] = ["#009e73", "#cc79a7", "#e69f00", "#56b4e9"];

fn left_out(lines: &Lines, outcome: &Outcome) -> String {
    let output = &lines.outputs[worst(outcome)];
    let of = |kind: Kind, value: &dyn Fn(&Line) -> f64| -> Vec<(f64, f64)> {
        let chosen = output.iter().filter(|line| line.kind == kind && value(line) > 0.0);
        chosen.map(|line| (line.hz, value(line))).collect()
    };
    let mut series =
        vec![Series::points("driven", of(Kind::Driven, &|line| line.measured)).colour(MEASURED).width(2.0)];
    for (kind, name, colour) in [(Kind::Odd, "odd, left out", "#0072b2"), (Kind::Even, "even", "#cc79a7")] {
        series.push(Series::points(name, of(kind, &|line| line.measured)).colour(colour).width(2.5));
        series.push(Series::line("", of(kind, &|line| line.simulated)).colour(colour).width(1.0));
    }
    series.push(
        Series::line("noise", output.iter().map(|line| (line.hz, line.noise)).collect()).colour(REFERENCE).dashed(),
    );
    let measured = || output.iter().map(|line| line.measured).filter(|x| *x > 0.0);
    let (low, high) = (measured().fold(f64::INFINITY, f64::min), measured().fold(0.0, f64::max));
    let y = Axis::log(format!("RMS of a line, {}", unit(&outcome.shown.units, worst(outcome))));
    chart(&Chart {
        title: String::new(),
        x: Axis::linear("frequency, Hz"),
        y: if high > low { y.range(low / 2.0, high * 2.0) } else { y },
        series,
        height: 220.0,
    })
}
