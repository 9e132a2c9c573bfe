//! The tables of the report.

use plid_report::{Cell, Report, Table};

use super::{cell, curves, number, of_all, share};
use crate::scores::{
    ALL, ARM, EFFECT, EQUATION, FAMILY, LEFT_OUT, NEAR, NUISANCE, OUTSIDER, OWN, STRONG_EFFECT, Scores, Totals,
};
use crate::statistics::Rate;
use crate::targets::{Target, WHOLE};

/// Adds the table of targets.
pub(super) fn targets(report: Report, scores: &Scores) -> Report {
    let mut table = Table::new("The targets, with 95 % intervals (Clopper-Pearson).")
        .column("figure", "")
        .column("found", "")
        .column("interval", "")
        .column("of", "")
        .column("wanted", "")
        .column("", "");
    for target in &scores.targets {
        let ends = target.ci95.map_or("–".to_owned(), |[low, high]| format!("{low:.3}–{high:.3}"));
        let sign = if target.at_least { "≥" } else { "≤" };
        let reached = match target.reached {
            Some(true) => "reached",
            Some(false) => "not\u{a0}reached",
            None => "no\u{a0}case\u{a0}asks",
        };
        table = table.row([
            target.what.as_str().into(),
            number(target.found, 3),
            Cell::Number(ends),
            target.of.into(),
            Cell::Number(format!("{sign} {:.3}", target.bound)),
            reached.into(),
        ]);
    }
    parts(report.heading("Targets").table(table), scores)
}

/// Adds the same figures for cases with fewer channels or records.
fn parts(report: Report, scores: &Scores) -> Report {
    if scores.parts.is_empty() {
        return report;
    }
    let mut table = Table::new(format!(
        "The same figures for reduced experiments, with the number of cases. In the column of the whole trial, single \
         effects are those that are {WHOLE}."
    ))
    .column("figure", "")
    .column("whole trial", "");
    for part in scores.parts.keys() {
        table = table.column(*part, "");
    }
    let found = |target: &Target| match target.found {
        Some(found) => Cell::Number(format!("{found:.3} of {}", target.of)),
        None => Cell::Number("–".to_owned()),
    };
    for (row, target) in scores.targets.iter().enumerate() {
        let parts: Option<Vec<Cell>> = scores.parts.values().map(|part| part.get(row).map(found)).collect();
        if let Some(parts) = parts {
            let what = target.what.trim_start_matches(&format!("{WHOLE}, "));
            table = table.row([what.into(), found(target)].into_iter().chain(parts));
        }
    }
    report.table(table)
}

/// Adds all other tables.
pub(super) fn all(report: Report, scores: &Scores) -> Report {
    let report = ceiling(answerers(report, scores), scores);
    let report = effects(report, scores);
    let report = outside(report, scores);
    let report = arms(report, scores);
    nuisances(report, scores)
}

type Reading = fn(&Totals) -> Rate;

fn answerers(report: Report, scores: &Scores) -> Report {
    let mut table = Table::new(
        "plid and the baselines on the same cases, per cent with 95 % intervals. Single effects are those of 2 % and \
         more.",
    )
    .column("figure", "");
    let all = of_all(scores, ALL, ALL);
    for (name, _) in &all {
        table = table.column(*name, "");
    }
    table = table.column("chance", "");
    let percent = |x: f64| Cell::fixed(100.0 * x, 0);
    let dash = || Cell::Number("–".to_owned());
    let guess = &scores.chance;
    let rows: [(&str, &str, &str, Reading, Cell); 9] = [
        ("own equation: exactly named", EQUATION, OWN, |t| t.exact, percent(guess.exact)),
        ("near miss: exactly named", EQUATION, NEAR, |t| t.exact, percent(guess.exact)),
        ("own equation: right family", EQUATION, OWN, |t| t.family, guess.family.map_or(dash(), percent)),
        ("own equation: right name and place", EQUATION, OWN, |t| t.located, dash()),
        ("own equation: in the 95 % set", EQUATION, OWN, |t| t.in_set, dash()),
        ("false alarms on none", ARM, "none", |t| t.false_alarms, percent(guess.false_alarms)),
        ("confident and wrong, of all cases", ALL, ALL, |t| t.confident_wrong, percent(0.0)),
        ("outsiders kept open", ARM, "outsider", |t| t.kept_open, dash()),
        ("pairs: both named", ARM, "pair", |t| t.all_named, dash()),
    ];
    for (name, by, is, read, chance) in rows {
        let found = of_all(scores, by, is);
        if found.is_empty() {
            continue;
        }
        let cells = found.iter().map(|(_, t)| cell(&read(t)));
        table = table.row([name.into()].into_iter().chain(cells).chain([chance]));
    }
    let shrink = [
        ("median held-out shrink, rightly named", (|t: &Totals| t.shrink_median) as fn(&Totals) -> Option<f64>),
        ("median held-out shrink, whatever was named", |t| t.shrink_of_all_median),
        ("Brier score of the first explanation", |t| t.calibration.brier),
    ];
    for (name, read) in shrink {
        let cells = all.iter().map(|(_, t)| number(read(t), 2));
        table = table.row([name.into()].into_iter().chain(cells).chain([dash()]));
    }
    report.heading("Compared with the baselines").table(table).paragraph(
        "BIC alone: effects of the full vocabulary, added one by one as long as BIC falls, without any test of \
         adequacy; it predicts with plid's simulation. Sparse regression: thresholded least squares on monomials of \
         commands, outputs and motions at the ports. Linear refit: all modes almost without bounds; it names the \
         frequency or damping that went furthest beyond the stated limits. The probabilities of all three are Schwarz \
         weights, exp(-BIC / 2). Chance: one of the 34 names with equal probability.",
    )
}

/// Adds the gaps that a black box leaves, in comparison with those of the answers.
fn ceiling(report: Report, scores: &Scores) -> Report {
    if scores.ceiling.is_empty() {
        return report;
    }
    let mut table = Table::new("Median gaps of the held-out records, per cent.")
        .column("cases", "")
        .column("number", "")
        .column("as given", "%")
        .column("plid", "%")
        .column("black box", "%")
        .column("background", "%")
        .column("plid leaves no more than the black box", "% of cases");
    for group in &scores.ceiling {
        let percent = |gap: Option<f64>| number(gap.map(|gap| 100.0 * gap), 2);
        table = table.row([
            group.is.as_str().into(),
            group.cases.into(),
            percent(group.as_given),
            percent(group.diagnosis),
            percent(group.black_box),
            percent(group.background),
            share(&group.diagnosis_is_closer),
        ]);
    }
    report.heading("What a model without physics closes").table(table).paragraph(
        "The black box is a Wiener-Hammerstein model of what the linear simulation leaves: curves of its commands, \
         outputs and motions at the ports, through its resonances and the last samples into each output, chosen and \
         regularised by a record that was not fitted. It names nothing. The background is what imperfections and noise \
         cause without the main effects. Simulators that are given by their outputs alone have no black box.",
    )
}

fn effects(report: Report, scores: &Scores) -> Report {
    let table = |caption: &str, by: &str| {
        let mut table = Table::new(caption)
            .column("effect", "")
            .column("cases", "")
            .column("exact", "%")
            .column("family", "%")
            .column("place", "%")
            .column("in the set", "%")
            .column("its size", "")
            .column("unknown", "%")
            .column("wrong", "% confidently")
            .column("shrink", "median")
            .column("covered", "% of parameters");
        for group in scores.by(by) {
            let t = &group.totals[0];
            table = table.row([
                group.is.as_str().into(),
                t.cases.into(),
                share(&t.exact),
                share(&t.family),
                share(&t.located),
                share(&t.in_set),
                number(t.set_size, 2),
                share(&t.called_unknown),
                share(&t.confident_wrong),
                number(t.shrink_median, 2),
                cell(&t.parameters_covered),
            ]);
        }
        table
    };
    report
        .heading("Effect by effect")
        .table(table("Families, single effects of 2 % and more.", FAMILY))
        .table(table("Single effects of 2 % and more.", STRONG_EFFECT))
        .figure(
            curves::power_by_effect(scores),
            "Share of the cases in which the effect alone was named, by the gap that it makes. Blank: no case of this \
             trial.",
        )
        .details("Single effects of all strengths", |report| {
            report.table(table("Single effects of all strengths.", EFFECT))
        })
}

fn outside(report: Report, scores: &Scores) -> Report {
    let mut table = Table::new("Causes outside the vocabulary.")
        .column("cause", "")
        .column("kept open", "%")
        .column("called unknown", "")
        .column("confident, wrong", "%");
    let mut rows = 0;
    for (by, prefix) in [(OUTSIDER, ""), (LEFT_OUT, "left out: ")] {
        for group in scores.by(by) {
            let t = &group.totals[0];
            let unknown = scores
                .cases
                .iter()
                .filter(|line| line.truth == group.is && line.asked == crate::judge::Asked::Outside)
                .filter(|line| line.judged[0].unknown)
                .count();
            let name: Cell = format!("{prefix}{}", group.is).into();
            table = table.row([name, cell(&t.kept_open), unknown.into(), cell(&t.confident_wrong)]);
            rows += 1;
        }
    }
    if rows == 0 { report } else { report.heading("Outside the vocabulary").table(table) }
}

fn arms(report: Report, scores: &Scores) -> Report {
    let mut table = Table::new("Arm by arm.")
        .column("arm", "")
        .column("cases", "")
        .column("exact, or all named", "%")
        .column("a wrong name", "%")
        .column("confident, wrong", "%")
        .column("stated gap right", "%")
        .column("stated that the shape differs", "% of near misses named")
        .column("shrink", "median")
        .column("shrink", "lowest tenth");
    for group in scores.by(ARM) {
        let t = &group.totals[0];
        let named = if t.exact.of > 0 { &t.exact } else { &t.all_named };
        table = table.row([
            group.is.as_str().into(),
            t.cases.into(),
            cell(named),
            cell(if t.false_alarms.of > 0 { &t.false_alarms } else { &t.spurious }),
            cell(&t.confident_wrong),
            cell(&t.stated_rightly),
            cell(&t.shape_differs),
            number(t.shrink_median, 2),
            number(t.shrink_lowest_tenth, 2),
        ]);
    }
    report.heading("Arm by arm").table(table)
}

fn nuisances(report: Report, scores: &Scores) -> Report {
    let mut table = Table::new("Cases with nothing missing, and single effects of 2 % and more, by nuisance.")
        .column("nuisance", "")
        .column("", "")
        .column("exact", "%")
        .column("family", "%")
        .column("name and place", "%")
        .column("in the set", "%")
        .column("false alarms", "%")
        .column("confident, wrong", "%")
        .column("shrink", "median");
    for group in scores.groups.iter().filter(|group| group.by.starts_with(NUISANCE)) {
        let t = &group.totals[0];
        table = table.row([
            group.by.trim_start_matches(NUISANCE).into(),
            group.is.as_str().into(),
            cell(&t.exact),
            cell(&t.family),
            cell(&t.located),
            cell(&t.in_set),
            cell(&t.false_alarms),
            cell(&t.confident_wrong),
            number(t.shrink_median, 2),
        ]);
    }
    report.heading("Sensitivity to nuisances").table(table)
}
