//! The second picture: where the gap lies.

use nalgebra::DMatrix;
use ndarray::Array2;
use plid_lab::report::{Axis, Chart, HeatMap, Report, Series, chart, heat_map};

use super::words::{percent, with};
use super::{GIVEN, WITH};
use crate::diagnose::Outcome;
use crate::effects::Side;
use crate::locate::{Map, STRETCHES};

/// A share that shows as more than nothing.
const HOLDS: f64 = 0.0005;

/// Bands that are drawn at least.
const FEWEST: usize = 8;

/// The section.
pub(super) fn section(report: Report, outcome: &Outcome) -> Report {
    let evidence = &outcome.evidence;
    let report = report.heading("2. Where").paragraph(sentence(outcome));
    let mut report = if evidence.before.share.sum() > 0.0 {
        report
            .figure(
                map(&evidence.before, &evidence.before.share, evidence.outputs.clone()),
                "Output by band: share of the squared gap of the simulation as given, beyond the noise, in all fitted records.",
            )
            .figure(
                map(&evidence.before, &evidence.before.time, stretches(outcome)),
                "Time by band: the same gap, over equal stretches of the fitted records.",
            )
    } else {
        report.paragraph("As given, the simulation leaves nothing beyond the noise: there is nothing to map.")
    };
    report = match levels(outcome) {
        Some(svg) => report.figure(svg, level_caption(outcome)),
        None => report.paragraph("The fitted random records have one level: how the gap grows with it cannot be said."),
    };
    report
}

fn sentence(outcome: &Outcome) -> String {
    let place = &outcome.diagnosis.place;
    let side = match place.side {
        Side::Actuator => "Side of the chain: actuator, between the command and the structure.",
        Side::Structure => "Side of the chain: structure.",
        Side::Sensor => "Side of the chain: sensor, between the structure and the record.",
        Side::Disturbance => "Side of the chain: disturbance, a force that no command causes.",
        Side::Time => "Side of the chain: time, something that changes while the records are taken.",
    };
    let bands: Vec<String> = place
        .bands_hz
        .iter()
        .map(|[from, to, share]| format!("{from:.0} to {to:.0} Hz ({})", percent(*share)))
        .collect();
    let bands = if bands.is_empty() { String::new() } else { format!(" Most of the gap: {}.", bands.join(", ")) };
    format!("{side}{bands}")
}

/// Shares in per cent over bands. Bands above the last that holds anything are left out.
fn map(of: &Map, share: &DMatrix<f64>, rows: Vec<String>) -> String {
    let holds =
        |b: usize| share.column(b).iter().any(|x| *x >= HOLDS) || of.share.column(b).iter().any(|x| *x >= HOLDS);
    let bands = (0..share.ncols()).rev().find(|&b| holds(b)).map_or(1, |b| b + 1).max(FEWEST.min(share.ncols()));
    heat_map(&HeatMap {
        rows,
        columns: of.edges.windows(2).take(bands).map(|edge| format!("{:.0}–{:.0}", edge[0], edge[1])).collect(),
        values: Array2::from_shape_fn((share.nrows(), bands), |(i, j)| {
            let percent = 100.0 * share[(i, j)];
            // Tenths are enough, and short enough for a cell.
            if percent < 10.0 { (10.0 * percent).round() / 10.0 } else { percent.round() }
        }),
        column_label: if bands < share.ncols() { "band, Hz (nothing above)" } else { "band, Hz" }.into(),
        value_label: "share, %".into(),
        range: None,
    })
}

/// Names of the stretches of time: when, and in which records.
fn stretches(outcome: &Outcome) -> Vec<String> {
    let fitted = &outcome.evidence.fitted;
    let rate = outcome.evidence.rate;
    let all: usize = fitted.iter().map(|(.., samples)| samples).sum();
    let each = all.div_ceil(STRETCHES).max(1);
    let stem = |name: &str| name.rsplit_once('.').map_or(name, |(stem, _)| stem).to_string();
    let one = |stretch: usize| {
        let (from, to) = ((stretch * each).min(all), ((stretch + 1) * each).min(all));
        let mut began = 0;
        let mut names: Vec<String> = Vec::new();
        let mut times: Option<(f64, f64)> = None;
        for (name, start_s, samples) in fitted {
            let (first, last) = (from.max(began), to.min(began + samples));
            if first < last {
                names.push(stem(name));
                let at = |sample: usize| start_s + (sample - began) as f64 / rate;
                times = Some((times.map_or(at(first), |(start, _)| start), at(last)));
            }
            began += samples;
        }
        let (start, end) = times?;
        let names = match names.as_slice() {
            [first, .., last] => format!("{first}–{last}"),
            names => names.concat(),
        };
        Some(format!("{start:.1}–{end:.1} s ({names})"))
    };
    (0..STRETCHES).map(|stretch| one(stretch).unwrap_or_default()).collect()
}

/// Gap against level, before and after, where there are two levels.
fn levels(outcome: &Outcome) -> Option<String> {
    let points = |map: &Map| -> Vec<(f64, f64)> {
        let usable = map.levels.iter().filter(|(level, gap)| *level > 0.0 && *gap > 0.0 && gap.is_finite());
        let mut points: Vec<(f64, f64)> = usable.map(|(level, gap)| (*level, 100.0 * gap)).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points
    };
    let (before, after) = (points(&outcome.evidence.before), points(&outcome.evidence.after));
    let (first, last) = (before.first()?.0, before.last()?.0);
    if last / first < 1.05 {
        return None;
    }
    let mut series = vec![
        Series::line("", before.clone()).colour(GIVEN),
        Series::points("as given", before.clone()).colour(GIVEN).width(5.0),
    ];
    if !after.is_empty() {
        series.push(Series::line("", after.clone()).colour(WITH));
        series.push(Series::points(with(outcome), after.clone()).colour(WITH).width(5.0));
    }
    // Room above and below, so that scatter does not look like a slope.
    let gaps = || before.iter().chain(&after).map(|(_, gap)| *gap);
    let (low, high) = (gaps().fold(f64::INFINITY, f64::min), gaps().fold(0.0, f64::max));
    Some(chart(&Chart {
        title: String::new(),
        x: Axis::log("level: RMS of the inputs, as recorded").range(first / 1.2, last * 1.2),
        y: Axis::log("gap beyond the noise, %").range(low / 2.0, high * 2.0),
        series,
        height: 200.0,
    }))
}

fn level_caption(outcome: &Outcome) -> String {
    let slope = match outcome.evidence.before.slope {
        // A zero has no sign.
        Some(slope) if slope.is_finite() && slope.abs() < 0.05 => {
            "As given, the relative gap does not change with the level.".into()
        }
        Some(slope) if slope.is_finite() => {
            format!("As given, the relative gap goes with the level to the power {slope:+.1}: ")
                + match slope {
                    s if s > 0.5 => {
                        "it grows, as with stiffness or damping that goes with the motion, clearance and limits."
                    }
                    s if s < -0.5 => "it falls, as with friction, hysteresis, offsets, hum and disturbances.",
                    _ => "it hardly changes, as with gains, delays, modes and drifts.",
                }
        }
        _ => "The levels are too near each other for a slope.".into(),
    };
    let after = &outcome.evidence.after.levels;
    let clean = after.iter().filter(|(_, gap)| !(*gap > 0.0)).count();
    let left = if clean > 0 {
        format!(" Not drawn: {clean} of {} records with nothing beyond the noise {}.", after.len(), with(outcome))
    } else {
        String::new()
    };
    format!("Gap beyond the noise against level, one point a random record that was fitted. {slope}{left}")
}

/// What is left, for the details.
pub(super) fn after(report: Report, outcome: &Outcome) -> Report {
    let evidence = &outcome.evidence;
    if !(evidence.after.share.sum() > 0.0) {
        return report;
    }
    report.details(format!("Where the rest lies, {}", with(outcome)), |report| {
        report
            .figure(
                map(&evidence.after, &evidence.after.share, evidence.outputs.clone()),
                "Output by band: share of what is left of the squared gap, beyond the noise.",
            )
            .figure(map(&evidence.after, &evidence.after.time, stretches(outcome)), "Time by band: the same.")
    })
}
