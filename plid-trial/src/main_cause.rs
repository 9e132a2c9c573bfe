//! Scores on imperfect truths: whether the main cause is found, whether small imperfections are mistaken for a main
//! cause, and whether the statements about the gap hold.

use std::collections::BTreeSet;

use serde::Serialize;

use crate::judge::Asked;
use crate::plan::Arm;
use crate::scores::{ALL, Line};
use crate::statistics::{Calibration, Rate, calibration, median};
use crate::targets::{Target, share, target};
use crate::vocabulary::family;

/// The figures of plid's answers over cases with imperfect truths.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MainCause {
    /// The property by which cases are grouped.
    pub by: String,
    /// The value of that property in this group.
    pub is: String,
    /// Number of cases.
    pub cases: usize,
    /// If the main cause is of the vocabulary: it is named first.
    pub first: Rate,
    /// If the main cause is of the vocabulary: it is named, in any position.
    pub named: Rate,
    /// If the main cause is of the vocabulary: it is named first and at its place.
    pub located: Rate,
    /// If the main cause is of the vocabulary: the verdict is unknown.
    pub called_unknown: Rate,
    /// If the main cause is outside the vocabulary: the answer keeps a cause outside the vocabulary open.
    pub kept_open: Rate,
    /// If there are only imperfections: an effect that does not act is named with a probability of 0.5 or more.
    pub likely_wrong: Rate,
    /// Among all cases: the first effect is named with a probability of 0.9 or more and does not act.
    pub confident_wrong: Rate,
    /// If the main cause is of the vocabulary: the median ratio of the held-out gap with the answer to that of the
    /// background.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub over_background: Option<f64>,
    /// Among all cases: the stated gap is within a quarter of the one found.
    pub stated_near: Rate,
    /// Among the cases with a stated 80 % interval: it contains the gap found.
    pub in_ci80: Rate,
    /// The calibration of the first explanation: whether all of its effects act, the main cause among them.
    pub explanations: Calibration,
    /// The calibration of every effect named: whether it acts at its place.
    pub statements: Calibration,
    /// The calibration of the statement about the remainder: whether a cause above `material` is not named.
    pub remainder: Calibration,
}

const VOCABULARY: &[Asked] = &[Asked::Single, Asked::Several];

impl MainCause {
    fn of(by: &str, is: &str, lines: &[&Line]) -> Self {
        let asked = |asked: &'static [Asked]| lines.iter().filter(move |line| asked.contains(&line.asked));
        let rate = |of: &'static [Asked], hit: &dyn Fn(&Line) -> bool| Rate::of(asked(of).map(|line| hit(line)));
        // An answer that predicts nothing leaves the gap as given.
        let left = |line: &Line| line.judged[0].gap.unwrap_or(line.gap_as_given);
        let over: Vec<f64> = asked(VOCABULARY)
            .filter_map(|line| line.gap_background.map(|background| left(line) / background))
            .collect();
        let explained: Vec<(f64, bool)> = lines.iter().filter_map(|line| line.judged[0].top).collect();
        let stated: Vec<(f64, bool)> =
            lines.iter().flat_map(|line| line.judged[0].statements.iter().copied()).collect();
        let remain: Vec<(f64, bool)> = lines.iter().filter_map(|line| line.judged[0].further_cause).collect();
        Self {
            by: by.to_owned(),
            is: is.to_owned(),
            cases: lines.len(),
            first: rate(VOCABULARY, &|line| line.judged[0].main_first),
            named: rate(VOCABULARY, &|line| line.judged[0].main_named),
            located: rate(VOCABULARY, &|line| line.judged[0].main_located),
            called_unknown: rate(VOCABULARY, &|line| line.judged[0].unknown),
            kept_open: rate(&[Asked::Outside], &|line| line.judged[0].open),
            likely_wrong: rate(&[Asked::None], &|line| line.judged[0].likely_wrong),
            confident_wrong: Rate::of(lines.iter().map(|line| line.judged[0].wrong)),
            over_background: median(&over),
            stated_near: Rate::of(lines.iter().map(|line| line.judged[0].stated_near)),
            in_ci80: Rate::of(lines.iter().filter_map(|line| line.judged[0].in_ci80)),
            explanations: calibration(&explained),
            statements: calibration(&stated),
            remainder: calibration(&remain),
        }
    }
}

/// Returns the figures of all cases with imperfect truths, followed by those of groups by family, arm and nuisance;
/// empty if there are no such cases. Second answers are not counted.
pub(crate) fn groups(lines: &[Line]) -> Vec<MainCause> {
    let imperfect: Vec<&Line> =
        lines.iter().filter(|line| line.gap_background.is_some() && line.without.is_empty()).collect();
    let mut groups = Vec::new();
    let mut add = |by: &str, is: &str, keep: &dyn Fn(&Line) -> bool| {
        let these: Vec<&Line> = imperfect.iter().copied().filter(|line| keep(line)).collect();
        if !these.is_empty() {
            groups.push(MainCause::of(by, is, &these));
        }
    };
    add(ALL, ALL, &|_| true);
    let families: BTreeSet<&str> = imperfect.iter().filter_map(|line| family(&line.truth)).collect();
    for name in families {
        add("family", name, &|line| line.asked == Asked::Single && family(&line.truth) == Some(name));
    }
    for (arm, name) in [(Arm::Pair, "pair"), (Arm::Triple, "triple"), (Arm::Outsider, "outsider")] {
        add("arm", name, &|line| line.arm == arm);
    }
    let nuisances: BTreeSet<(&String, &String)> = imperfect.iter().flat_map(|line| &line.nuisances).collect();
    for (key, value) in nuisances {
        add(key, value, &|line| line.nuisances.get(key) == Some(value));
    }
    groups
}

/// Returns the targets on imperfect truths.
pub(crate) fn targets(all: &MainCause) -> Vec<Target> {
    let calibrated = |what: &str, found: &Calibration| target(what, false, 0.04, found.expected_error, found.of);
    vec![
        share("main cause named first", true, 0.85, Some(all.first)),
        share("main cause named first, at its place", true, 0.80, Some(all.located)),
        share("main cause called unknown", false, 0.08, Some(all.called_unknown)),
        share("outsiders kept open", true, 0.85, Some(all.kept_open)),
        share("confident and wrong, of all cases", false, 0.03, Some(all.confident_wrong)),
        share("imperfections only: 0.5 or more for an absent effect", false, 0.05, Some(all.likely_wrong)),
        target("held-out gap over the background's, median", false, 0.8, all.over_background, all.first.of),
        share("stated gap within a quarter", true, 0.85, Some(all.stated_near)),
        share("stated 80 % interval holds the gap found", true, 0.75, Some(all.in_ci80)),
        share("stated 80 % interval holds the gap found, and is not too wide", false, 0.87, Some(all.in_ci80)),
        calibrated("expected calibration error of first explanations", &all.explanations),
        calibrated("expected calibration error of named effects", &all.statements),
    ]
}
