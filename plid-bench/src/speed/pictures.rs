//! The pictures of the report.

use ndarray::Array2;
use plid_catalogue::{CovarianceName, ExpectationName, ScalarName};
use plid_report::{Axis, Chart, HeatMap, Series, chart, heat_map};

use super::cell::{expectations, word};
use super::outcome::{Outcome, Timing};
use super::targets::SAMPLE_US;
use crate::Noise;

/// Grey, for references.
const REFERENCE: &str = "#8f8f8f";

/// Returns all pictures that the measured cells permit, with their captions.
pub fn all(outcome: &Outcome) -> Vec<(String, String)> {
    let mut pictures = Vec::new();
    if let Some(expectations) = shown_expectation(outcome) {
        pictures.push(time(outcome, expectations));
        pictures.extend(ratios(outcome));
        pictures.push(roofline(outcome, ScalarName::F64, expectations));
        pictures.push(tails(outcome, expectations));
    }
    pictures
}

/// Returns the expectation for which the pictures of all forms are drawn, which is the default one if it was
/// measured.
pub fn shown_expectation(outcome: &Outcome) -> Option<ExpectationName> {
    let measured = |e: &ExpectationName| plain(outcome).any(|timing| timing.cell.variant.expectations == *e);
    Some(ExpectationName::default()).filter(measured).or_else(|| expectations().into_iter().find(measured))
}

/// Returns the numbers of states measured in f64 on plain loops and one thread, with three inputs and outputs and
/// diagonal noise.
pub fn sizes(outcome: &Outcome) -> Vec<usize> {
    let mut sizes: Vec<usize> = plain(outcome).map(|timing| timing.cell.states).collect();
    sizes.sort_unstable();
    sizes.dedup();
    sizes
}

fn plain(outcome: &Outcome) -> impl Iterator<Item = &Timing> {
    outcome
        .timings
        .iter()
        .filter(|timing| timing.cell.is_plain() && timing.cell.noise == Noise::Diagonal && timing.cell.inputs == 3)
}

fn time(outcome: &Outcome, expectations: ExpectationName) -> (String, String) {
    let mut series: Vec<Series> = Vec::new();
    for (form, colour) in CovarianceName::all().into_iter().zip(COLOURS.into_iter().cycle()) {
        let points: Vec<(f64, f64)> = sizes(outcome)
            .into_iter()
            .filter_map(|states| outcome.plain(states, form, expectations))
            .map(|timing| (timing.joint_states as f64, timing.median_us))
            .collect();
        if !points.is_empty() {
            series.push(Series::points("", points.clone()).colour(colour));
            series.push(Series::line(word(&form), points).colour(colour));
        }
    }
    let mut limits: Vec<_> = outcome.limits.iter().filter(|limit| limit.scalar == ScalarName::F64).collect();
    limits.sort_by_key(|limit| limit.joint_states);
    let of = |y: fn(&&super::outcome::Limits) -> f64| limits.iter().map(|l| (l.joint_states as f64, y(l))).collect();
    series.push(Series::line("pass over P", of(|limit| limit.full_us)).colour(REFERENCE));
    series.push(Series::line("pass over one triangle", of(|limit| limit.triangle_us)).colour(REFERENCE).dashed());
    let svg = chart(&Chart {
        title: String::new(),
        x: Axis::log("N, size of P").range(40.0, 600.0),
        y: Axis::log("median time of a step, us"),
        series,
        height: 380.0,
    });
    let caption = format!(
        "Time of a step in f64 on one thread, {}, against the size of P; in grey the machine's limit.",
        word(&expectations)
    );
    (svg, caption)
}

/// Colours of the forms, those of Okabe and Ito.
const COLOURS: [&str; 4] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7"];

fn ratios(outcome: &Outcome) -> Option<(String, String)> {
    let states = sizes(outcome).into_iter().max()?;
    let columns = expectations();
    let mut rows: Vec<(String, Vec<f64>)> = Vec::new();
    for noise in [Noise::Diagonal, Noise::Full] {
        for form in CovarianceName::all() {
            let passes = columns.iter().map(|&expectations| {
                let timing = outcome.of(states, form, expectations, |cell| cell.noise = noise);
                timing.map_or(f64::NAN, |timing| timing.passes)
            });
            let passes: Vec<f64> = passes.collect();
            if passes.iter().any(|value| value.is_finite()) {
                let name = if noise == Noise::Full { format!("{}, full noise", word(&form)) } else { word(&form) };
                rows.push((name, passes));
            }
        }
    }
    let values = Array2::from_shape_fn((rows.len(), columns.len()), |(i, j)| rows[i].1[j]);
    let svg = heat_map(&HeatMap {
        rows: rows.into_iter().map(|row| row.0).collect(),
        columns: columns.iter().map(word).collect(),
        values,
        column_label: "conditional expectation".into(),
        value_label: "passes over P".into(),
        range: None,
    });
    Some((svg, format!("A step at n = {states} in f64 on one thread, in passes over P.")))
}

fn roofline(outcome: &Outcome, scalar: ScalarName, expectations: ExpectationName) -> (String, String) {
    let intensity = |timing: &Timing| timing.operations.total() as f64 / timing.bytes;
    let mut series = Vec::new();
    let largest = outcome.limits.iter().filter(|limit| limit.scalar == scalar).max_by_key(|limit| limit.joint_states);
    if let (Some(limit), Some(peak)) = (largest, outcome.peak(scalar)) {
        let roof =
            (0..=80).map(|k| 10f64.powf(-1.0 + f64::from(k) / 32.0)).map(|x| (x, (x * limit.gbytes_s).min(peak)));
        let label = format!("limit: {:.0} GB/s at N = {}, {peak:.0} Gflop/s", limit.gbytes_s, limit.joint_states);
        series.push(Series::line(label, roof.collect()).colour(REFERENCE).width(2.0));
    }
    for (form, colour) in CovarianceName::all().into_iter().zip(COLOURS.into_iter().cycle()) {
        let points: Vec<(f64, f64)> = sizes(outcome)
            .into_iter()
            .filter_map(|states| outcome.of(states, form, expectations, |cell| cell.variant.scalar = scalar))
            .map(|timing| (intensity(timing), timing.gflops))
            .collect();
        if !points.is_empty() {
            series.push(Series::line("", points.clone()).colour(colour).width(0.8));
            series.push(Series::points(word(&form), points).colour(colour));
        }
    }
    let svg = chart(&Chart {
        title: String::new(),
        x: Axis::log("operations per byte of P, flop/B").range(0.1, 30.0),
        y: Axis::log("operations done, Gflop/s"),
        series,
        height: 340.0,
    });
    let caption = format!(
        "Roofline in {} with {}: a point a size, the smallest n to the left. On the sloping part memory limits, on the \
         level part arithmetic.",
        word(&scalar),
        word(&expectations)
    );
    (svg, caption)
}

fn tails(outcome: &Outcome, expectations: ExpectationName) -> (String, String) {
    let mut series = Vec::new();
    for (form, colour) in CovarianceName::all().into_iter().zip(COLOURS.into_iter().cycle()) {
        let timings: Vec<&Timing> =
            sizes(outcome).into_iter().filter_map(|states| outcome.plain(states, form, expectations)).collect();
        if timings.is_empty() {
            continue;
        }
        let line = |y: fn(&Timing) -> f64| timings.iter().map(|t| (t.joint_states as f64, y(t))).collect::<Vec<_>>();
        series.push(Series::line(word(&form), line(|t| t.median_us)).colour(colour));
        series.push(Series::points("", line(|t| t.p99_us)).colour(colour));
        series.push(Series::line("", line(|t| t.p99_9_us)).colour(colour).dashed());
    }
    series.push(Series::level("625 us, a sample at 1600 Hz", SAMPLE_US).colour(REFERENCE));
    let svg = chart(&Chart {
        title: String::new(),
        x: Axis::log("N, size of P").range(40.0, 600.0),
        y: Axis::log("time of a step, us"),
        series,
        height: 340.0,
    });
    (
        svg,
        format!(
            "Median (line), p99 (points) and p99.9 (dashed) of single steps, f64, one thread, {}.",
            word(&expectations)
        ),
    )
}
