//! The report of a trial: how often the right effect is named, and how often a wrong one is named with confidence,
//! against the strength of the effect; the targets; and the tables.

mod cases;
mod curves;
mod main_cause;
mod reliability;
mod tables;

pub(crate) use curves::{before_and_after, power, reliability};

use plid_data::config::to_toml;
use plid_report::{Cell, Report};

use crate::config::TrialConfig;
use crate::scores::{ALL, ANSWERERS, ARM, EQUATION, NEAR, OWN, Scores, Totals};
use crate::statistics::Rate;

/// Returns the page.
pub(crate) fn page(scores: &Scores, config: &TrialConfig) -> Report {
    let mut report = Report::new(format!("Blind trial: {}", scores.name));
    for sentence in sentences(scores) {
        report = report.verdict(sentence);
    }
    report = curves::first(report, scores);
    report = tables::targets(report, scores);
    report = main_cause::section(report, scores);
    report = curves::equations(report, scores);
    report = curves::calibrated(report, scores);
    report = reliability::section(report, scores);
    report = tables::all(report, scores);
    report = cases::section(report, scores);
    report
        .listing("The trial:", to_toml(config))
        .listing(
            "The commands, each run in its own process:",
            format!(
                "plid gap trial draw TRIAL.toml --out T --sealed S --seed {}\nplid gap trial diagnose T\nplid gap \
                 trial score T --sealed S{}",
                scores.seed,
                if scores.scored() < scores.of { " --answered" } else { "" }
            ),
        )
        .provenance("diagnosed by", scores.program.as_ref().map_or("nobody".to_owned(), ToString::to_string))
        .provenance("drawn by", scores.drawn_by.to_string())
        .provenance("SHA-256 of all answers, fixed before any label was opened", &scores.answers_sha256)
        .provenance("total time of the diagnosis in seconds", format!("{:.0}", scores.time.total_s))
}

fn sentences(scores: &Scores) -> Vec<String> {
    let mut sentences = Vec::new();
    let kept = scores.targets.iter().filter(|t| t.reached == Some(true)).count();
    let asked = scores.targets.iter().filter(|t| t.reached.is_some()).count();
    sentences.push(format!("{}; {kept} of the {asked} targets that this trial can show are reached.", scores.extent()));
    sentences.extend(scores.failures());
    sentences.extend(main_cause::sentences(scores));
    for (is, equation) in [(OWN, "the vocabulary's own equation"), (NEAR, "another law of the same physics")] {
        if let Some(t) = scores.totals(EQUATION, is, 0) {
            sentences.push(format!(
                "Single effects of 2 % and more with {equation}: exactly named {}, in the 95 % set {}.",
                words(&t.exact),
                words(&t.in_set)
            ));
        }
    }
    if let Some(t) = scores.totals(ARM, "none", 0) {
        sentences.push(format!("False alarms where nothing is missing: {}.", words(&t.false_alarms)));
    }
    if let Some(t) = scores.totals(ALL, ALL, 0) {
        sentences.push(format!("Confident and wrong, of all cases: {}.", words(&t.confident_wrong)));
    }
    sentences
}

/// Formats a rate as "12 of 14 (86 %, 57 to 98)".
fn words(rate: &Rate) -> String {
    match (rate.share, rate.ci95) {
        (Some(share), Some([low, high])) => format!(
            "{} of {} ({:.0}\u{a0}%, 95\u{a0}% interval {:.0} to {:.0})",
            rate.hits,
            rate.of,
            100.0 * share,
            100.0 * low,
            100.0 * high
        ),
        _ => "no case asks".to_owned(),
    }
}

/// Formats a rate as "86 (57–98) of 14": per cent, interval and number of cases.
fn cell(rate: &Rate) -> Cell {
    match share(rate) {
        Cell::Number(text) if rate.of > 0 => Cell::Number(format!("{text} of {}", rate.of)),
        dash => dash,
    }
}

/// Formats a rate without the number of cases.
fn share(rate: &Rate) -> Cell {
    Cell::Number(match (rate.share, rate.ci95) {
        (Some(share), Some([low, high])) => {
            format!("{:.0} ({:.0}–{:.0})", 100.0 * share, 100.0 * low, 100.0 * high)
        }
        _ => "–".to_owned(),
    })
}

fn number(value: Option<f64>, decimals: usize) -> Cell {
    Cell::fixed(value.unwrap_or(f64::NAN), decimals)
}

/// Returns the totals of every answerer for a group that all of them have.
fn of_all<'a>(scores: &'a Scores, by: &str, is: &str) -> Vec<(&'static str, &'a Totals)> {
    (0..ANSWERERS.len()).filter_map(|who| Some((ANSWERERS[who], scores.totals(by, is, who)?))).collect()
}
