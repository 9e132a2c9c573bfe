//! The reliability curve of each kind of statement.

use plid_gap::answer::schema::About;
use plid_report::{Cell, Report, Table};

use super::curves::{COLOURS, diagram, figures};
use super::share;
use crate::scores::Scores;

/// Returns the meaning of a kind of statement.
fn meaning(about: About) -> &'static str {
    match about {
        About::Effect => "The first effect acts at its place",
        About::Explanation => "The effects of the first explanation act at their places, and no others do",
        About::Further => "A further effect acts at its place",
        About::Nothing => "Nothing is missing",
        About::Unknown => "The cause is outside the vocabulary",
        About::Remainder => "A cause that the answer does not name makes more than what the case calls material",
    }
}

/// Adds a curve for each kind of statement, and the table of their points.
pub(super) fn section(report: Report, scores: &Scores) -> Report {
    if scores.reliability.is_empty() {
        return report;
    }
    let mut report = report.heading("Reliability of each kind of statement");
    let mut table = Table::new("The points of the curves, with 95 % intervals (Clopper-Pearson).")
        .column("statement", "")
        .column("stated", "%, mean")
        .column("true", "%")
        .column("statements", "");
    for one in &scores.reliability {
        let found = &one.calibration;
        let caption = format!(
            "{}: true in {} of {}, in ten equal bins of the stated probability. The band is the 95 % interval \
             (Clopper-Pearson). {}.",
            meaning(one.about),
            one.right.hits,
            one.right.of,
            figures(found)
        );
        let svg = diagram(&[(one.about.name(), found, COLOURS[0])], "stated probability, %");
        report = report.figure(svg, caption);
        for bin in &found.bins {
            let stated = Cell::fixed(100.0 * bin.stated, 1);
            table = table.row([one.about.name().into(), stated, share(&bin.came_true), bin.came_true.of.into()]);
        }
    }
    report.table(table)
}
