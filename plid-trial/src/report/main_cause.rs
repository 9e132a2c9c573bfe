//! Tables of trials with imperfect truths.

use plid_report::{Report, Table};

use super::{cell, number, share, words};
use crate::scores::Scores;

/// Returns the results in sentences.
pub(super) fn sentences(scores: &Scores) -> Vec<String> {
    let Some(all) = scores.main_cause.first() else { return Vec::new() };
    vec![
        format!("Main cause named first: {}; called unknown: {}.", words(&all.first), words(&all.called_unknown)),
        format!("Outsiders kept open: {}.", words(&all.kept_open)),
        format!(
            "Cases with imperfections only in which an effect that is absent was named with 0.5 or more: {}.",
            words(&all.likely_wrong)
        ),
    ]
}

/// Adds the table of main causes by family, arm and nuisance.
pub(super) fn section(report: Report, scores: &Scores) -> Report {
    if scores.main_cause.is_empty() {
        return report;
    }
    let mut table = Table::new("Cases with a main cause and small imperfections (per cent, 95 % intervals).")
        .column("cases", "")
        .column("", "")
        .column("number", "")
        .column("named first", "%")
        .column("named", "%")
        .column("at its place", "%")
        .column("called unknown", "%")
        .column("kept open", "%")
        .column("likely and wrong", "% of none")
        .column("confident, wrong", "%")
        .column("gap over background", "median")
        .column("stated within a quarter", "%")
        .column("in the 80 % interval", "%");
    for group in &scores.main_cause {
        table = table.row([
            group.by.as_str().into(),
            group.is.as_str().into(),
            group.cases.into(),
            share(&group.first),
            share(&group.named),
            share(&group.located),
            share(&group.called_unknown),
            cell(&group.kept_open),
            cell(&group.likely_wrong),
            share(&group.confident_wrong),
            number(group.over_background, 2),
            share(&group.stated_near),
            cell(&group.in_ci80),
        ]);
    }
    report.heading("Imperfect truths").table(table).paragraph(
        "The background is the gap of the held-out record without the main cause, noise included, relative to a \
         simulation whose own parameters are exact. An imperfection that is named at its place is not a wrong name, \
         but it is not the main cause either.",
    )
}
