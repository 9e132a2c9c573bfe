//! The plots of the report.

use ndarray::Array2;
use plid_report::{Axis, Chart, HeatMap, Report, Series, chart, charts, heat_map};

use crate::scores::{ALL, ANSWERERS, EFFECT, GAP, GAP_NEAR, GAP_OF, GAP_OWN, GAPS, Scores, Totals, gap_bin};
use crate::statistics::{Calibration, Rate};

pub(super) const COLOURS: [&str; 4] = ["#0072b2", "#d55e00", "#009e73", "#e69f00"];
const GREY: &str = "#8f8f8f";

/// Returns the position of a bin: its geometric mean in per cent, with open bins taken to be as wide as the others.
fn middle(bin: usize) -> f64 {
    let (low, high) = (GAPS[bin], GAPS[bin + 1]);
    let (low, high) = (if low == 0.0 { high / 2.0 } else { low }, if high.is_infinite() { 2.0 * low } else { high });
    100.0 * (low * high).sqrt()
}

type Reading = fn(&Totals) -> Rate;

/// Returns the rate in each bin of strength that has cases, with the position of the bin.
fn points(scores: &Scores, by: &str, who: usize, read: Reading) -> Vec<(f64, Rate)> {
    (0..GAPS.len() - 1)
        .filter_map(|bin| Some((middle(bin), read(scores.totals(by, &gap_bin(bin), who)?))))
        .filter(|(_, rate)| rate.of > 0)
        .collect()
}

fn line(points: &[(f64, Rate)]) -> Vec<(f64, f64)> {
    points.iter().map(|(x, rate)| (*x, 100.0 * rate.share.unwrap_or(f64::NAN))).collect()
}

fn band(points: &[(f64, Rate)]) -> Vec<(f64, f64, f64)> {
    let ends = |rate: &Rate| rate.ci95.unwrap_or([f64::NAN; 2]);
    points.iter().map(|(x, rate)| (*x, 100.0 * ends(rate)[0], 100.0 * ends(rate)[1])).collect()
}

fn strength() -> Axis {
    Axis::log("gap that the effect makes alone, %").range(0.5, 40.0)
}

fn percent(label: &str) -> Axis {
    // The range is a little wider than 0 to 100, so that markers at its ends are drawn whole.
    Axis::linear(label).range(-4.0, 104.0).step(25.0)
}

fn panel(scores: &Scores, label: &str, read: Reading, chance: Option<f64>) -> Chart {
    let mut series = Vec::new();
    let ours = points(scores, GAP, 0, read);
    series.push(Series::band("", band(&ours)).colour(COLOURS[0]));
    for who in (0..ANSWERERS.len()).rev() {
        let found = line(&points(scores, GAP, who, read));
        let name = if chance.is_some() { ANSWERERS[who] } else { "" };
        let width = if who == 0 { 2.4 } else { 1.4 };
        series.push(Series::line(name, found.clone()).colour(COLOURS[who]).width(width));
        series.push(Series::points("", found).colour(COLOURS[who]).width(3.0));
    }
    if let Some(chance) = chance {
        series.push(Series::level("chance", 100.0 * chance).colour(GREY));
    }
    Chart { title: String::new(), x: strength(), y: percent(label), series, height: 190.0 }
}

/// Plots power and confident wrong names against strength, if any case has a single effect.
pub(crate) fn power(scores: &Scores) -> Option<String> {
    (!points(scores, GAP, 0, |t| t.exact).is_empty()).then(|| {
        charts(&[
            panel(scores, "exactly named, %", |t| t.exact, Some(scores.chance.exact)),
            panel(scores, "confident and wrong, %", |t| t.confident_wrong, None),
        ])
    })
}

/// Adds the plot with its caption.
pub(super) fn first(report: Report, scores: &Scores) -> Report {
    let Some(svg) = power(scores) else {
        return report.paragraph("No case of this trial has a single effect: there is no power to show.");
    };
    report.heading("Power against strength").figure(
        svg,
        "Single effects. Above: exactly the true effect was named. Below: the first name was wrong but stated with a \
         probability of 0.9 or more. The band is plid's 95 % interval (Clopper-Pearson).",
    )
}

/// Plots the vocabulary's own equations and the near misses separately.
pub(super) fn equations(report: Report, scores: &Scores) -> Report {
    let mut series = Vec::new();
    for (by, name, colour) in [(GAP_OWN, "own equation", COLOURS[0]), (GAP_NEAR, "near miss in shape", "#cc79a7")] {
        for (read, kind, dashed) in [
            ((|t: &Totals| t.exact) as Reading, "exactly named", false),
            ((|t: &Totals| t.in_set) as Reading, "in the 95 % set", true),
        ] {
            let found = points(scores, by, 0, read);
            if !dashed {
                series.push(Series::band("", band(&found)).colour(colour));
            }
            let points = line(&found);
            let line = Series::line(format!("{name}: {kind}"), points.clone()).colour(colour).width(2.0);
            series.push(if dashed { line.dashed() } else { line });
            series.push(Series::points("", points).colour(colour).width(3.0));
        }
    }
    let chart_of = Chart { title: String::new(), x: strength(), y: percent("of the cases, %"), series, height: 190.0 };
    report.heading("Own equation and near miss in shape").figure(
        chart(&chart_of),
        "plid on single effects whose law is the vocabulary's own equation, and on those that follow another law of \
         the same physics.",
    )
}

/// Plots the power for each effect at each strength.
pub(super) fn power_by_effect(scores: &Scores) -> String {
    let kinds: Vec<&str> = scores.by(EFFECT).map(|group| group.is.as_str()).collect();
    let bins: Vec<String> = (0..GAPS.len() - 1).map(gap_bin).collect();
    let share = |(i, j): (usize, usize)| {
        let totals = scores.totals(&format!("{GAP_OF}{}", kinds[i]), &bins[j], 0);
        totals.and_then(|t| t.exact.share).map_or(f64::NAN, |share| 100.0 * share)
    };
    heat_map(&HeatMap {
        values: Array2::from_shape_fn((kinds.len(), bins.len()), share),
        rows: kinds.into_iter().map(str::to_owned).collect(),
        columns: bins.clone(),
        column_label: "gap that the effect makes alone".to_owned(),
        value_label: "exactly named, %".to_owned(),
        range: Some((0.0, 100.0)),
    })
}

/// Plots observed frequencies against stated probabilities: each calibration with its name and colour, the last one
/// with its 95 % interval.
pub(super) fn diagram(of: &[(&str, &Calibration, &str)], label: &str) -> String {
    let mut series = vec![Series::line("perfect", vec![(0.0, 0.0), (100.0, 100.0)]).colour(GREY).dashed()];
    for (k, (name, calibration, colour)) in of.iter().enumerate() {
        let found: Vec<(f64, Rate)> = calibration.bins.iter().map(|bin| (100.0 * bin.stated, bin.came_true)).collect();
        if k + 1 == of.len() {
            series.push(Series::band("", band(&found)).colour(colour));
        }
        series.push(Series::line(*name, line(&found)).colour(colour));
        series.push(Series::points("", line(&found)).colour(colour).width(3.5));
    }
    let x = Axis::linear(label).range(0.0, 100.0).step(10.0);
    chart(&Chart { title: String::new(), x, y: percent("it is true, %"), series, height: 220.0 })
}

/// Returns the reliability diagram: of first explanations and named effects if truths are imperfect, otherwise of the
/// first explanations of all answerers.
pub(crate) fn reliability(scores: &Scores) -> Option<String> {
    if let Some(all) = scores.main_cause.first() {
        let of = [
            ("first explanations", &all.explanations, COLOURS[1]),
            ("effects that are named", &all.statements, COLOURS[0]),
        ];
        return Some(diagram(&of, "stated probability, %"));
    }
    let of = |who: usize| Some((ANSWERERS[who], &scores.totals(ALL, ALL, who)?.calibration, COLOURS[who]));
    let all: Vec<_> = (0..ANSWERERS.len()).rev().filter_map(of).collect();
    (!all.is_empty()).then(|| diagram(&all, "stated probability of the first explanation, %"))
}

/// Returns the reliability diagram of probabilities before and after calibration.
pub(crate) fn before_and_after(before: &Calibration, after: &Calibration) -> String {
    diagram(&[("before", before, COLOURS[1]), ("after calibration", after, COLOURS[0])], "stated probability, %")
}

pub(super) fn figures(calibration: &Calibration) -> String {
    let text = |x: Option<f64>| x.map_or("–".to_owned(), |x| format!("{x:.3}"));
    format!("Brier score {}, expected calibration error {}", text(calibration.brier), text(calibration.expected_error))
}

/// Adds the diagram with its caption.
pub(super) fn calibrated(report: Report, scores: &Scores) -> Report {
    let Some(svg) = reliability(scores) else { return report };
    let caption = match (scores.main_cause.first(), scores.totals(ALL, ALL, 0)) {
        (Some(all), _) => format!(
            "Cases with imperfect truths, in ten equal bins of the stated probability. First explanations: {}. \
            Effects that are named, each at its place: {}. The band is their 95 % interval (Clopper-Pearson).",
            figures(&all.explanations),
            figures(&all.statements)
        ),
        (None, Some(totals)) => {
            format!("All cases, in ten equal bins of the stated probability. {}.", figures(&totals.calibration))
        }
        (None, None) => return report,
    };
    report.heading("Calibration").figure(svg, caption)
}
