//! The second and third sections: the location of the gap, and what remains.

use nalgebra::DMatrix;
use ndarray::Array2;
use plid_report::{Axis, Bar, Bars, Chart, HeatMap, Report, Series, bars as bars_of, chart, heat_map};

use super::words::{percent, unbroken, with};
use super::{GIVEN, WITH};
use crate::answer::schema::Where;
use crate::answer::statements::what_remains;
use crate::diagnose::Outcome;
use crate::effects::Side;
use crate::judge::locate::{Estimate, LevelGap, Map, STRETCHES};
use crate::words::band;

/// Smallest visible share.
const HOLDS: f64 = 0.0005;

/// Smallest number of bands that are drawn.
const FEWEST: usize = 8;

/// Adds the section.
pub(super) fn section(report: Report, outcome: &Outcome) -> Report {
    let shown = &outcome.shown;
    let report = report.heading("2. Where").paragraph(sentence(&outcome.diagnosis.place));
    let mut report = if shown.before.share.sum() > 0.0 {
        report
            .figure(
                map(&shown.before, &shown.before.share, shown.outputs.clone()),
                "Output by band: share of the squared gap of the simulation as given, in excess of the noise, in all \
                fitted records.",
            )
            .figure(
                map(&shown.before, &shown.before.time, stretches(outcome)),
                "Time by band: this gap by equal intervals of time in the fitted records.",
            )
            .figure(
                shares(outcome),
                "Share of the gap by output, by frequency band (largest only) and by time interval. Whiskers: 95 % \
                intervals from a block bootstrap.",
            )
    } else {
        report.paragraph("The initial simulation leaves only noise, so no map is shown.")
    };
    report = match levels(outcome) {
        Some(svg) => report.figure(svg, level_caption(outcome)),
        None => report
            .paragraph("The fitted records have only one level, so the dependence of the gap on the level is unknown."),
    };
    report
}

/// States the part of the signal path, and the places and bands with the largest shares.
pub(crate) fn sentence(place: &Where) -> String {
    let side = match place.side {
        _ if !place.side_is_clear => "Part of the signal path: not clear from the residual.",
        None => "",
        Some(Side::Actuator) => "Part of the signal path: actuator, between the command and the structure.",
        Some(Side::Structure) => "Part of the signal path: structure.",
        Some(Side::Sensor) => "Part of the signal path: sensor, between the structure and the record.",
        Some(Side::Disturbance) => "Part of the signal path: disturbance, a force that no command causes.",
        Some(Side::Time) => "Part of the signal path: time, a change during the records.",
    };
    let bands: Vec<String> =
        place.bands_hz.iter().map(|[from, to, share]| format!("{} ({})", band(*from, *to), percent(*share))).collect();
    let bands = if bands.is_empty() { String::new() } else { format!(" Most of the gap: {}.", bands.join(", ")) };
    let places: Vec<String> =
        place.places.iter().take(3).map(|p| format!("{} ({}) {}", p.place, part(p.side), percent(p.share))).collect();
    let places = if places.is_empty() {
        String::new()
    } else {
        format!(
            " Share of the residual beyond noise and limits that each place alone could explain: {}.",
            places.join(", ")
        )
    };
    format!("{side}{places}{bands}")
}

fn part(side: Side) -> &'static str {
    match side {
        Side::Actuator => "actuator",
        Side::Structure => "structure",
        Side::Sensor => "sensor",
        Side::Disturbance => "disturbance",
        Side::Time => "change over time",
    }
}

/// Draws shares in per cent over bands. Bands above the last visible one are left out.
fn map(of: &Map, share: &DMatrix<f64>, rows: Vec<String>) -> String {
    let holds =
        |b: usize| share.column(b).iter().any(|x| *x >= HOLDS) || of.share.column(b).iter().any(|x| *x >= HOLDS);
    let bands = (0..share.ncols()).rev().find(|&b| holds(b)).map_or(1, |b| b + 1).max(FEWEST.min(share.ncols()));
    heat_map(&HeatMap {
        rows,
        columns: of.edges.windows(2).take(bands).map(|edge| format!("{:.0}–{:.0}", edge[0], edge[1])).collect(),
        values: Array2::from_shape_fn((share.nrows(), bands), |(i, j)| {
            let percent = 100.0 * share[(i, j)];
            // Tenths of a per cent suffice and fit into a cell.
            if percent < 10.0 { (10.0 * percent).round() / 10.0 } else { percent.round() }
        }),
        column_label: if bands < share.ncols() { "band, Hz (nothing above)" } else { "band, Hz" }.into(),
        value_label: "share, %".into(),
        range: None,
    })
}

/// Returns the names of the stretches of time: their times and their records.
fn stretches(outcome: &Outcome) -> Vec<String> {
    let fitted = &outcome.shown.fitted;
    let rate = outcome.shown.rate;
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

/// Largest number of outputs in a figure of shares.
const MOST_OUTPUTS: usize = 12;

/// Draws the shares of outputs, bands and stretches with their intervals.
fn shares(outcome: &Outcome) -> String {
    let (shown, place) = (&outcome.shown, &outcome.diagnosis.place);
    let map = &shown.before;
    let bar = |name: String, share: Estimate| Bar {
        name,
        value: 100.0 * share.value,
        text: format!("{} ({} to {})", percent(share.value), percent(share.ci95[0]), percent(share.ci95[1])),
        interval: Some((100.0 * share.ci95[0], 100.0 * share.ci95[1])),
        strong: false,
    };
    let outputs = shown.outputs.iter().zip(&map.outputs).take(MOST_OUTPUTS);
    let bands = place.bands_hz.iter().zip(&place.bands_ci95);
    let bars = outputs
        .map(|(name, share)| bar(name.clone(), *share))
        .chain(bands.map(|([from, to, value], &ci95)| bar(band(*from, *to), Estimate { value: *value, ci95 })))
        .chain(stretches(outcome).into_iter().zip(&map.stretches).map(|(name, share)| bar(name, *share)))
        .collect();
    bars_of(&Bars { bars, label: "share of the squared gap beyond the noise, %".into(), reference: None })
}

/// Smallest ratio of the highest to the lowest level for which the gap is drawn against the level. On a narrower
/// axis, all points would lie above one another.
const LEAST_SPAN: f64 = 1.05;

/// Magnitude below which a slope counts as zero, which has no sign: half of the last digit that is printed.
const ZERO_SLOPE: f64 = 0.05;

/// Draws the gap against the level, before and after, if there are two levels.
fn levels(outcome: &Outcome) -> Option<String> {
    let usable = |map: &Map| -> Vec<LevelGap> {
        let mut usable: Vec<LevelGap> = map
            .levels
            .iter()
            .filter(|l| l.level > 0.0 && l.gap.value > 0.0 && l.gap.value.is_finite())
            .cloned()
            .collect();
        usable.sort_by(|a, b| a.level.total_cmp(&b.level));
        usable
    };
    let (before, after) = (usable(&outcome.shown.before), usable(&outcome.shown.after));
    let (first, last) = (before.first()?.level, before.last()?.level);
    if last / first < LEAST_SPAN {
        return None;
    }
    let mut series = Vec::new();
    for (levels, name, colour) in [(&before, "as given", GIVEN), (&after, with(outcome), WITH)] {
        let points: Vec<(f64, f64)> = levels.iter().map(|l| (l.level, 100.0 * l.gap.value)).collect();
        // An interval that reaches zero has no lower end on a logarithmic axis.
        let whisker = |l: &LevelGap| {
            let [low, high] = l.gap.ci95.map(|gap| 100.0 * gap.max(0.1 * l.gap.value));
            (l.level, low, high)
        };
        series.push(Series::line("", points.clone()).colour(colour));
        series.push(Series::whiskers(levels.iter().map(whisker)).colour(colour));
        series.push(Series::points(name, points).colour(colour).width(5.0));
    }
    // Without room above and below, scatter would look like a slope.
    let gaps = || before.iter().chain(&after).map(|l| 100.0 * l.gap.value);
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
    let stated = outcome.diagnosis.settings.answer.level_slope;
    let slope = match outcome.shown.before.slope {
        Some(Estimate { value, .. }) if value.abs() < ZERO_SLOPE => {
            "As given, the relative gap does not change with the level.".into()
        }
        Some(Estimate { value, ci95: [low, high] }) => {
            format!(
                "As given, the relative gap is proportional to the level to the power {value:+.1} ({low:+.1} to \
                {high:+.1}): "
            ) + match value {
                s if s > stated => {
                    "it grows, as with stiffness or damping that depends on the motion, clearance and limits."
                }
                s if s < -stated => "it falls, as with friction, hysteresis, offsets, hum and disturbances.",
                _ => "it hardly changes, as with gains, delays, modes and drifts.",
            }
        }
        None => "No slope is given: too few levels have a gap above the noise, or the levels are too similar.".into(),
    };
    let after = &outcome.shown.after.levels;
    let clean = after.iter().filter(|l| !(l.gap.value > 0.0)).count();
    let left = if clean > 0 {
        format!(" {clean} of {} records are omitted because only noise remains {}.", after.len(), with(outcome))
    } else {
        String::new()
    };
    format!(
        "Gap in excess of the noise against level, with 95 % intervals: one point for each fitted random record, or \
        for each periodic one if the random records have only one level. {slope}{left}"
    )
}

/// Adds the section on what remains.
pub(super) fn remains(report: Report, outcome: &Outcome) -> Report {
    let (diagnosis, shown) = (&outcome.diagnosis, &outcome.shown);
    let words = what_remains(&diagnosis.remainder, &diagnosis.settings.answer);
    let report = report.heading("3. What remains").paragraph(unbroken(&words));
    if !(shown.after.share.sum() > 0.0) {
        return report;
    }
    report.figure(
        map(&shown.after, &shown.after.share, shown.outputs.clone()),
        format!(
            "Output by band: share of the squared gap that remains {}, in excess of the noise, in all fitted records.",
            with(outcome)
        ),
    )
}

/// Adds the course of the remainder over time, for the details.
pub(super) fn after(report: Report, outcome: &Outcome) -> Report {
    let shown = &outcome.shown;
    if !(shown.after.share.sum() > 0.0) {
        return report;
    }
    report.details(format!("When the remainder occurs, {}", with(outcome)), |report| {
        report.figure(
            map(&shown.after, &shown.after.time, stretches(outcome)),
            "Time by band: share of the remaining squared gap, in excess of the noise.",
        )
    })
}
