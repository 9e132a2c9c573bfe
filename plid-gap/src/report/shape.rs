//! The curves of the laws that were found at ports.

use plid_report::{Axis, Chart, Report, Series, chart};

use super::WITH;
use super::words::at;
use crate::answer::shape::Shape;
use crate::diagnose::Outcome;

/// Adds the curve of each named law without memory.
pub(super) fn figures(report: Report, outcome: &Outcome) -> Report {
    outcome.diagnosis.shapes.iter().fold(report, |report, shape| report.figure(figure(shape), caption(shape)))
}

fn figure(shape: &Shape) -> String {
    let mut series = Vec::new();
    if let Some(ci95) = &shape.ci95 {
        let band = shape.points.iter().zip(ci95).map(|([x, _], [low, high])| (*x, *low, *high)).collect();
        series.push(Series::band("95 % interval", band).colour(WITH));
    }
    series.push(Series::line("as fitted", shape.points.iter().map(|[x, f]| (*x, *f)).collect()).colour(WITH));
    chart(&Chart {
        title: String::new(),
        x: Axis::linear(labelled(shape.over.name(), &shape.unit)),
        y: Axis::linear(labelled("force", &shape.force_unit)),
        series,
        height: 180.0,
    })
}

/// Returns a quantity with its unit; the quantity alone if its unit is not known.
fn labelled(quantity: &str, unit: &str) -> String {
    if unit == quantity { quantity.into() } else { format!("{quantity}, {unit}") }
}

fn caption(shape: &Shape) -> String {
    let family = shape.family.as_ref().map_or_else(String::new, |family| format!(" (family: {family})"));
    let band = if shape.ci95.is_some() { " Band: 95 % interval, from the covariance of the parameters." } else { "" };
    format!(
        "Shape of {}{family}: force on the structure over the {} of its port, over the range of motion in the fitted \
        records. Where the records cannot tell laws of one family apart, their curves are close there.{band}",
        at(&shape.effect, &shape.location),
        shape.over.name(),
    )
}
