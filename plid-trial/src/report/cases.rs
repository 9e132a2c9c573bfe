//! Tables of the cases to inspect by hand: false alarms, confident wrong names, and failures.

use plid_report::{Cell, Report, Table};

use crate::judge::Asked;
use crate::scores::{Line, Scores};

pub(super) fn section(report: Report, scores: &Scores) -> Report {
    let report = report.heading("Case by case").warnings(scores.failures());
    let alarms = |line: &Line| line.asked == Asked::None && line.judged[0].spurious;
    let wrong = |line: &Line| line.judged[0].wrong && !alarms(line);
    let report = table(report, scores, "False alarms.", &alarms);
    let report = table(report, scores, "Confident and wrong.", &wrong);
    report.details("All cases", |report| table(report, scores, "All cases.", &|_| true))
}

fn table(report: Report, scores: &Scores, caption: &str, keep: &dyn Fn(&Line) -> bool) -> Report {
    let lines: Vec<&Line> = scores.cases.iter().filter(|line| keep(line)).collect();
    if lines.is_empty() {
        return report.paragraph(format!("{caption} None."));
    }
    let mut table = Table::new(caption)
        .column("case", "")
        .column("truth", "")
        .column("gap alone", "%")
        .column("gap as given", "%")
        .column("law", "")
        .column("nuisances", "")
        .column("said", "")
        .column("at", "")
        .column("gap with it", "%")
        .column("shrink", "");
    for line in lines {
        let judged = &line.judged[0];
        let nuisances = line.nuisances.iter().map(|(key, value)| format!("{key} {value}")).collect::<Vec<_>>();
        table = table.row([
            line.case.as_str().into(),
            line.truth.as_str().into(),
            Cell::fixed(100.0 * line.gap, 1),
            Cell::fixed(100.0 * line.gap_as_given, 1),
            if line.own_equation { "own" } else { "near miss" }.into(),
            nuisances.join(", ").into(),
            judged.said.as_str().into(),
            judged.at.as_str().into(),
            Cell::fixed(100.0 * judged.gap.unwrap_or(f64::NAN), 1),
            Cell::fixed(if line.asked == Asked::None { f64::NAN } else { judged.shrink }, 2),
        ]);
    }
    report.table(table)
}
