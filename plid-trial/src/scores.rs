//! The scores of all cases together: shares with intervals, by question, effect, family, strength and nuisance.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;

use crate::baselines::chance;
use crate::ceiling::{self, Ceiling};
use crate::judge::{Asked, Judged};
use crate::main_cause::{self, MainCause};
use crate::plan::Arm;
use crate::program::Program;
use crate::reliability::{Reliability, reliability};
use crate::statistics::{Calibration, Rate, calibration, lowest_tenth, median};
use crate::targets::{Target, parts, targets};
use crate::vocabulary::{family, whole};

/// The names of the answerers: plid first, then the baselines.
pub const ANSWERERS: [&str; 4] = ["plid", "BIC alone", "sparse regression", "linear refit"];

/// The scores of a case.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Line {
    /// The name of the case.
    pub case: String,
    /// The arm for which it was drawn.
    pub arm: Arm,
    /// The question that it asks.
    pub asked: Asked,
    /// Names of the true effects, or "none".
    pub truth: String,
    /// The gap that the weakest true effect makes alone.
    pub gap: f64,
    /// Whether all true effects follow the vocabulary's own equations.
    pub own_equation: bool,
    /// The effects that were removed from the vocabulary for this answer.
    pub without: Vec<String>,
    /// The gap of the simulation as given.
    pub gap_as_given: f64,
    /// The gap that the noise makes alone.
    pub gap_floor: f64,
    /// The gap that imperfections and noise make without the main effects; `None` if the truth has no imperfections.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gap_background: Option<f64>,
    /// The gap that the black box leaves; `None` without a simulation as a model, or without an answer.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gap_black_box: Option<f64>,
    /// The nuisances of the case, by name.
    pub nuisances: BTreeMap<String, String>,
    /// The reason for a missing answer.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub failed: Option<String>,
    /// For each parameter of a correctly named effect, whether the stated 95 % interval contains the true value.
    pub covered: BTreeMap<String, bool>,
    /// The judgements, in the order of [`ANSWERERS`].
    pub judged: [Judged; 4],
}

/// The figures of one answerer over a group of cases.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Totals {
    /// Number of cases.
    pub cases: usize,
    /// Among the cases with nothing missing: an effect was named that does not act.
    pub false_alarms: Rate,
    /// Among the cases with one effect: it alone was named.
    pub exact: Rate,
    /// Among the cases with one effect: the first effect named is of its family.
    pub family: Rate,
    /// Among the cases with one effect: it is named first, at its place.
    pub located: Rate,
    /// Among the cases with one effect: it is in the 95 % set.
    pub in_set: Rate,
    /// Among the cases with one effect: the mean size of the 95 % set.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub set_size: Option<f64>,
    /// Among the cases with several effects: all were named and no other.
    pub all_named: Rate,
    /// Among the cases with effects of the vocabulary: an effect was named that does not act.
    pub spurious: Rate,
    /// Among all cases: a wrong effect was named with confidence.
    pub confident_wrong: Rate,
    /// Among the effects named with confidence: the wrong ones.
    pub wrong_of_confident: Rate,
    /// Among the cases with effects of the vocabulary: the verdict is unknown.
    pub called_unknown: Rate,
    /// Among the cases with an effect outside the vocabulary: the answer keeps a cause outside the vocabulary open.
    pub kept_open: Rate,
    /// The median reduction of the gap, over the cases whose effects are correctly named and whose gap exceeds the
    /// noise.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shrink_median: Option<f64>,
    /// The lowest decile of that reduction.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shrink_lowest_tenth: Option<f64>,
    /// Number of these cases.
    pub shrink_of: usize,
    /// The median reduction over all cases with an effect and a gap that exceeds the noise, whatever was named.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shrink_of_all_median: Option<f64>,
    /// Among the correctly named cases: the stated gap is within 5 % of the gap as given.
    pub stated_rightly: Rate,
    /// Among the correctly named near misses: the answer states that the shape differs.
    pub shape_differs: Rate,
    /// Among the parameters of correctly named effects: the stated interval contains the true value.
    pub parameters_covered: Rate,
    /// The calibration of the probability of the first explanation.
    pub calibration: Calibration,
}

/// Cases that share a property.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Group {
    /// The property by which cases are grouped.
    pub by: String,
    /// The value of that property in this group.
    pub is: String,
    /// The figures, in the order of [`ANSWERERS`].
    pub totals: Vec<Totals>,
}

/// The expected scores of a guess.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Chance {
    /// Probability of the right name.
    pub exact: f64,
    /// Probability of a name of the right family: the mean over the single effects of the trial.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub family: Option<f64>,
    /// Probability that an effect is named where nothing is missing.
    pub false_alarms: f64,
}

/// The durations of the cases in seconds, which differ from run to run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Time {
    /// The sum over the cases.
    pub total_s: f64,
    /// The median.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub median_s: Option<f64>,
    /// The longest duration.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub longest_s: Option<f64>,
}

/// The content of scores.json.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Scores {
    /// The name of the trial.
    pub name: String,
    /// The seed from which it was drawn.
    pub seed: u64,
    /// SHA-256 of all answers, recorded before any sealed file was opened.
    pub answers_sha256: String,
    /// Number of draws that were repeated.
    pub repeated_draws: usize,
    /// The program that answered.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub program: Option<Program>,
    /// The program that drew the cases.
    pub drawn_by: Program,
    /// Number of cases that were drawn. Cases without an answer are not scored.
    pub of: usize,
    /// The names of the answerers.
    pub answerers: [&'static str; 4],
    /// The targets.
    pub targets: Vec<Target>,
    /// The figures of the targets for each of [`PARTS`] that has cases.
    pub parts: BTreeMap<&'static str, Vec<Target>>,
    /// The scores on imperfect truths: all cases, then groups of them; empty if there are none.
    pub main_cause: Vec<MainCause>,
    /// The reliability of each kind of statement in plid's answers.
    pub reliability: Vec<Reliability>,
    /// The gap that a black box leaves, beside that of plid's answer; empty if no case has both.
    pub ceiling: Vec<Ceiling>,
    /// The expected scores of a guess.
    pub chance: Chance,
    /// The figures of all groups.
    pub groups: Vec<Group>,
    /// The scores of all cases.
    pub cases: Vec<Line>,
    /// The durations.
    pub time: Time,
}

/// The edges of the bins of strength.
pub const GAPS: [f64; 7] = [0.0, 0.01, 0.02, 0.04, 0.08, 0.16, f64::INFINITY];
/// The smallest gap to which the targets apply.
pub const STRONG: f64 = 0.02;

/// The group of all cases.
pub const ALL: &str = "all";
/// The groups by arm.
pub const ARM: &str = "arm";
/// The groups of single effects by gap.
pub const GAP: &str = "gap";
/// The groups of single effects with the vocabulary's own equation by gap.
pub const GAP_OWN: &str = "gap, own equation";
/// The groups of near misses in shape by gap.
pub const GAP_NEAR: &str = "gap, near miss";
/// The groups of single effects at or above [`STRONG`] by equation.
pub const EQUATION: &str = "equation";
/// The groups of single effects by name.
pub const EFFECT: &str = "effect";
/// The groups of single effects at or above [`STRONG`] by name.
pub const STRONG_EFFECT: &str = "effect, gap >= 2 %";
/// The groups of single effects at or above [`STRONG`] by family.
pub const FAMILY: &str = "family, gap >= 2 %";
/// The prefix of the groups of one single effect by gap, which exist for plid only; the name of the effect follows.
pub const GAP_OF: &str = "gap of ";
/// The groups of effects outside the vocabulary by name.
pub const OUTSIDER: &str = "outsider";
/// The groups of effects that were removed from the vocabulary by name.
pub const LEFT_OUT: &str = "left out";
/// The prefix of the groups by nuisance, whose name follows: cases with nothing missing, and single effects at or above
/// [`STRONG`].
pub const NUISANCE: &str = "nuisance: ";
/// Parts of a trial for which the targets' figures are repeated: their names, and the nuisances with their values that
/// define them.
pub const PARTS: [(&str, &[(&str, &str)]); 3] = [
    ("passive", &[("experiment", "passive")]),
    ("one input, one output", &[("inputs", "1"), ("outputs", "1")]),
    ("simulator by outputs", &[("simulator", "outputs")]),
];
/// The prefix of the groups within a part, whose name follows: all of it, an arm, or single effects at or above
/// [`STRONG`] by equation.
pub const PART: &str = "part: ";
/// The value of [`EQUATION`] for the vocabulary's own equation.
pub const OWN: &str = "own";
/// The value of [`EQUATION`] for another law of the same physics.
pub const NEAR: &str = "near miss";

/// Returns a bin of strength in words, such as "1 % to 2 %".
pub fn gap_bin(bin: usize) -> String {
    let percent = |x: f64| format!("{:.0} %", 100.0 * x);
    match (GAPS[bin], GAPS[bin + 1]) {
        (0.0, high) => format!("below {}", percent(high)),
        (low, high) if high.is_infinite() => format!("from {}", percent(low)),
        (low, high) => format!("{} to {}", percent(low), percent(high)),
    }
}

impl Totals {
    /// Counts the figures of one answerer over some cases.
    pub fn of<'a>(lines: impl IntoIterator<Item = &'a Line>, answerer: usize) -> Self {
        let lines: Vec<(&Line, &Judged)> = lines.into_iter().map(|line| (line, &line.judged[answerer])).collect();
        let asked = |asked: &'static [Asked]| lines.iter().filter(move |(line, _)| asked.contains(&line.asked));
        let rate = |asked_of: &'static [Asked], hit: fn(&Judged) -> bool| {
            Rate::of(asked(asked_of).map(|(_, judged)| hit(judged)))
        };
        const VOCABULARY: &[Asked] = &[Asked::Single, Asked::Several];
        let right = || asked(VOCABULARY).filter(|(_, judged)| judged.right);
        let shrinks: Vec<f64> = right().filter(|(_, j)| j.shrinkable).map(|(_, j)| j.shrink).collect();
        let of_all: Vec<f64> = asked(VOCABULARY).filter(|(_, j)| j.shrinkable).map(|(_, j)| j.shrink).collect();
        let sizes: Vec<f64> = asked(&[Asked::Single]).map(|(_, j)| j.set_size as f64).collect();
        let near =
            lines.iter().filter(|(line, judged)| line.asked == Asked::Single && !line.own_equation && judged.exact);
        let tops: Vec<(f64, bool)> = lines.iter().filter_map(|(_, judged)| judged.top).collect();
        let covered = lines.iter().filter(|_| answerer == 0).flat_map(|(line, _)| line.covered.values().copied());
        Self {
            cases: lines.len(),
            false_alarms: rate(&[Asked::None], |j| j.spurious),
            exact: rate(&[Asked::Single], |j| j.exact),
            family: rate(&[Asked::Single], |j| j.family),
            located: rate(&[Asked::Single], |j| j.located),
            in_set: rate(&[Asked::Single], |j| j.in_set),
            set_size: (!sizes.is_empty()).then(|| sizes.iter().sum::<f64>() / sizes.len() as f64),
            all_named: rate(&[Asked::Several], |j| j.all_named),
            spurious: rate(VOCABULARY, |j| j.spurious),
            confident_wrong: Rate::of(lines.iter().map(|(_, j)| j.wrong)),
            wrong_of_confident: Rate::of(lines.iter().filter(|(_, j)| j.confident).map(|(_, j)| j.wrong)),
            called_unknown: rate(VOCABULARY, |j| j.unknown),
            kept_open: rate(&[Asked::Outside], |j| j.open),
            shrink_median: median(&shrinks),
            shrink_lowest_tenth: lowest_tenth(&shrinks),
            shrink_of: shrinks.len(),
            shrink_of_all_median: median(&of_all),
            stated_rightly: Rate::of(right().map(|(_, j)| j.missed_by.is_some_and(|by| by < 0.05))),
            shape_differs: Rate::of(near.map(|(_, j)| j.shape_differs)),
            parameters_covered: Rate::of(covered),
            calibration: calibration(&tops),
        }
    }
}

/// Returns all groups of a trial's cases.
fn groups(lines: &[Line]) -> Vec<Group> {
    let mut groups = Groups { lines, groups: Vec::new() };
    groups.add(ALL, ALL, &|_| true);
    groups.by_arm();
    groups.by_gap();
    groups.by_equation();
    groups.by_part();
    groups.by_effect();
    groups.by_outsider();
    groups.by_nuisance();
    groups.groups
}

fn name(arm: Arm) -> String {
    let name = serde_json::to_value(arm).ok();
    name.as_ref().and_then(|name| name.as_str()).unwrap_or_default().to_owned()
}

fn single(line: &Line) -> bool {
    line.asked == Asked::Single
}

fn strong(line: &Line) -> bool {
    single(line) && line.gap >= STRONG
}

/// The groups so far, and the lines that they are taken from.
struct Groups<'a> {
    lines: &'a [Line],
    groups: Vec<Group>,
}

impl Groups<'_> {
    /// Adds the group of the lines to keep, if there are any.
    fn add(&mut self, by: &str, is: &str, keep: &dyn Fn(&Line) -> bool) {
        let these: Vec<&Line> = self.lines.iter().filter(|line| keep(line)).collect();
        if !these.is_empty() {
            let answerers = if by.starts_with(GAP_OF) { 1 } else { ANSWERERS.len() };
            let totals = (0..answerers).map(|who| Totals::of(these.iter().copied(), who)).collect();
            self.groups.push(Group { by: by.to_owned(), is: is.to_owned(), totals });
        }
    }

    fn by_arm(&mut self) {
        for arm in [Arm::None, Arm::Single, Arm::Pair, Arm::Triple, Arm::Outsider, Arm::LeaveOneOut] {
            self.add(ARM, &name(arm), &|line| line.arm == arm);
        }
    }

    fn by_gap(&mut self) {
        for bin in 0..GAPS.len() - 1 {
            let within = |line: &Line| single(line) && (GAPS[bin]..GAPS[bin + 1]).contains(&line.gap);
            self.add(GAP, &gap_bin(bin), &within);
            self.add(GAP_OWN, &gap_bin(bin), &|line| within(line) && line.own_equation);
            self.add(GAP_NEAR, &gap_bin(bin), &|line| within(line) && !line.own_equation);
        }
    }

    fn by_equation(&mut self) {
        // The targets apply to cases with all three inputs and outputs, an active experiment, and a simulation given
        // as a model.
        let is = |line: &Line, key: &str, value: &str| line.nuisances.get(key).is_none_or(|said| said == value);
        let full = |line: &Line| {
            is(line, "experiment", "active")
                && is(line, "inputs", "3")
                && is(line, "outputs", "3")
                && is(line, "simulator", "model")
        };
        self.add(EQUATION, OWN, &|line| strong(line) && full(line) && line.own_equation);
        self.add(EQUATION, NEAR, &|line| strong(line) && full(line) && !line.own_equation);
    }

    fn by_part(&mut self) {
        for (part, asked) in PARTS {
            let within =
                |line: &Line| asked.iter().all(|(key, value)| line.nuisances.get(*key).is_some_and(|is| is == value));
            let mut add = |is: &str, keep: &dyn Fn(&Line) -> bool| {
                self.add(&format!("{PART}{part}"), is, &|line| within(line) && keep(line));
            };
            add(ALL, &|_| true);
            add(OWN, &|line| strong(line) && line.own_equation);
            add(NEAR, &|line| strong(line) && !line.own_equation);
            for arm in [Arm::None, Arm::Outsider, Arm::Pair, Arm::Triple] {
                add(&name(arm), &|line| line.arm == arm);
            }
        }
    }

    fn by_effect(&mut self) {
        let whole = whole();
        for kind in &whole {
            self.add(EFFECT, kind.name, &|line| single(line) && line.truth == kind.name);
            self.add(STRONG_EFFECT, kind.name, &|line| strong(line) && line.truth == kind.name);
            self.add(LEFT_OUT, kind.name, &|line| line.arm == Arm::LeaveOneOut && line.truth == kind.name);
        }
        for kind in &whole {
            for bin in 0..GAPS.len() - 1 {
                let within = |line: &Line| (GAPS[bin]..GAPS[bin + 1]).contains(&line.gap) && line.truth == kind.name;
                self.add(&format!("{GAP_OF}{}", kind.name), &gap_bin(bin), &|line| single(line) && within(line));
            }
        }
        let families: BTreeSet<&str> = whole.iter().map(|kind| kind.family.name()).collect();
        for name in families {
            self.add(FAMILY, name, &|line| strong(line) && family(&line.truth) == Some(name));
        }
    }

    fn by_outsider(&mut self) {
        let outsiders: BTreeSet<&str> =
            self.lines.iter().filter(|line| line.arm == Arm::Outsider).map(|line| line.truth.as_str()).collect();
        for name in outsiders {
            self.add(OUTSIDER, name, &|line| line.arm == Arm::Outsider && line.truth == name);
        }
    }

    fn by_nuisance(&mut self) {
        let nuisances: BTreeSet<(&String, &String)> = self.lines.iter().flat_map(|line| &line.nuisances).collect();
        for (key, value) in nuisances {
            let asks = |line: &Line| line.asked == Asked::None || strong(line);
            self.add(&format!("{NUISANCE}{key}"), value, &|line| asks(line) && line.nuisances.get(key) == Some(value));
        }
    }
}

/// The data of the scores other than the cases.
pub(crate) struct Given {
    pub name: String,
    pub seed: u64,
    pub answers_sha256: String,
    pub repeated_draws: usize,
    pub of: usize,
    pub program: Option<Program>,
    pub drawn_by: Program,
    pub seconds: Vec<f64>,
}

impl Scores {
    pub(crate) fn new(given: Given, cases: Vec<Line>) -> Self {
        let groups = groups(&cases);
        let main_cause = main_cause::groups(&cases);
        let singles: Vec<f64> =
            cases.iter().filter(|c| c.asked == Asked::Single).map(|c| chance::right_family(&c.truth)).collect();
        let family = (!singles.is_empty()).then(|| singles.iter().sum::<f64>() / singles.len() as f64);
        let chance = Chance { exact: chance::exact(), family, false_alarms: chance::false_alarm() };
        let time = Time {
            total_s: given.seconds.iter().sum(),
            median_s: median(&given.seconds),
            longest_s: given.seconds.iter().copied().max_by(f64::total_cmp),
        };
        Self {
            name: given.name,
            seed: given.seed,
            answers_sha256: given.answers_sha256,
            repeated_draws: given.repeated_draws,
            program: given.program,
            drawn_by: given.drawn_by,
            of: given.of,
            answerers: ANSWERERS,
            targets: main_cause.first().map_or_else(|| targets(&groups), main_cause::targets),
            parts: if main_cause.is_empty() { parts(&groups) } else { BTreeMap::new() },
            main_cause,
            reliability: reliability(&cases),
            ceiling: ceiling::groups(&cases),
            chance,
            groups,
            cases,
            time,
        }
    }

    /// Returns the number of scored cases. A second answer is not a separate case.
    pub fn scored(&self) -> usize {
        self.cases.iter().filter(|line| line.without.is_empty()).count()
    }

    /// Returns the number of cases in words.
    pub fn extent(&self) -> String {
        match self.scored() {
            all if all == self.of => format!("{all} cases"),
            some => format!("{some} of {} cases (the others have no answer and do not count)", self.of),
        }
    }

    /// Returns a sentence about the failed diagnoses, with the reasons; `None` if none failed.
    pub fn failures(&self) -> Option<String> {
        let mut cases_of: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
        for line in &self.cases {
            if let Some(why) = &line.failed {
                cases_of.entry(why).or_default().push(&line.case);
            }
        }
        if cases_of.is_empty() {
            return None;
        }
        let failed: usize = cases_of.values().map(Vec::len).sum();
        let mut reasons: Vec<_> = cases_of.into_iter().collect();
        reasons.sort_by_key(|(_, cases)| std::cmp::Reverse(cases.len()));
        let reasons: Vec<String> = reasons
            .into_iter()
            .map(|(why, cases)| format!("{} ({})", why.trim_end_matches('.'), cases.join(", ")))
            .collect();
        let of = self.cases.len();
        Some(format!("{failed} of {of} diagnoses failed and count as wrong: {}.", reasons.join("; ")))
    }

    /// Returns the figures of a group for one answerer.
    pub fn totals(&self, by: &str, is: &str, answerer: usize) -> Option<&Totals> {
        totals(&self.groups, by, is, answerer)
    }

    /// Returns the groups by one property.
    pub fn by(&self, by: &str) -> impl Iterator<Item = &Group> {
        self.groups.iter().filter(move |group| group.by == by)
    }
}

pub(crate) fn totals<'a>(groups: &'a [Group], by: &str, is: &str, answerer: usize) -> Option<&'a Totals> {
    groups.iter().find(|group| group.by == by && group.is == is).and_then(|group| group.totals.get(answerer))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the line of a single effect with a gap that is named correctly or not at all, or of a case with
    /// nothing missing.
    fn line(case: &str, truth: &str, gap: f64, own: bool, named: bool) -> Line {
        let asked = if truth == "none" { Asked::None } else { Asked::Single };
        let judged = Judged {
            named,
            exact: named && truth != "none",
            right: named == (truth != "none"),
            spurious: named && truth == "none",
            shrinkable: true,
            shrink: if named { 0.9 } else { 0.1 },
            shape_differs: named && !own,
            top: Some((0.8, named)),
            ..Judged::default()
        };
        Line {
            case: case.to_owned(),
            arm: if truth == "none" { Arm::None } else { Arm::Single },
            asked,
            truth: truth.to_owned(),
            gap,
            own_equation: own,
            without: Vec::new(),
            gap_as_given: gap,
            gap_floor: 0.01,
            gap_background: None,
            gap_black_box: None,
            nuisances: BTreeMap::from([("ports".to_owned(), if own { "yes" } else { "no" }.to_owned())]),
            failed: None,
            covered: BTreeMap::from([("k".to_owned(), named)]),
            judged: [judged, Judged::default(), Judged::default(), Judged::default()],
        }
    }

    #[test]
    fn cases_count_where_they_belong() {
        let mut lines = vec![
            line("case-1", "clearance", 0.03, true, true),
            line("case-2", "clearance", 0.03, false, true),
            line("case-3", "clearance", 0.015, true, false),
            line("case-4", "sensor-gain", 0.3, true, false),
            line("case-5", "none", 0.0, true, false),
            line("case-6", "none", 0.0, true, true),
        ];
        for k in [2, 5] {
            lines[k].nuisances.extend(["inputs", "outputs"].map(|key| (key.to_owned(), "1".to_owned())));
        }
        let given = Given {
            name: "t".to_owned(),
            seed: 1,
            answers_sha256: String::new(),
            repeated_draws: 0,
            program: None,
            drawn_by: Program::this().unwrap(),
            of: 6,
            seconds: vec![2.0, 4.0],
        };
        let scores = Scores::new(given, lines);
        let count = |by: &str, is: &str, read: fn(&Totals) -> Rate| {
            scores.totals(by, is, 0).map(|t| (read(t).hits, read(t).of))
        };
        assert_eq!(count(ALL, ALL, |t| t.exact), Some((2, 4)));
        assert_eq!(count(ARM, "none", |t| t.false_alarms), Some((1, 2)));
        assert_eq!(count(GAP, &gap_bin(2), |t| t.exact), Some((2, 2)));
        assert_eq!(count(GAP_OWN, &gap_bin(2), |t| t.exact), Some((1, 1)));
        assert_eq!(count(&format!("{GAP_OF}clearance"), &gap_bin(1), |t| t.exact), Some((0, 1)));
        // The third case is below 2 %.
        assert_eq!(count(EQUATION, OWN, |t| t.exact), Some((1, 2)));
        assert_eq!(count(EQUATION, NEAR, |t| t.shape_differs), Some((1, 1)));
        assert_eq!(count(EFFECT, "clearance", |t| t.exact), Some((2, 3)));
        assert_eq!(count(FAMILY, "structure-nonlinear", |t| t.exact), Some((2, 2)));
        // There is one near miss. With ports there are two strong single effects, and two cases with nothing missing
        // that count for false alarms.
        assert_eq!(count("nuisance: ports", "no", |t| t.exact), Some((1, 1)));
        assert_eq!(count("nuisance: ports", "yes", |t| t.exact), Some((1, 2)));
        assert_eq!(count("nuisance: ports", "yes", |t| t.false_alarms), Some((1, 2)));
        // The shrink is that of correctly named effects. Only plid states intervals.
        let all = scores.totals(ALL, ALL, 0).unwrap();
        assert_eq!((all.shrink_median, all.shrink_of), (Some(0.9), 2));
        assert_eq!((all.parameters_covered.hits, all.parameters_covered.of), (3, 6));
        assert_eq!(scores.totals(ALL, ALL, 1).unwrap().parameters_covered.of, 0);
        // Seven of 34 names belong to a port, four to linear sensors.
        assert!((scores.chance.family.unwrap() - (3.0 * 7.0 + 4.0) / 4.0 / 34.0).abs() < 1e-12);
        assert_eq!((scores.time.total_s, scores.time.longest_s), (6.0, Some(4.0)));
        // The part with one channel has a weak effect and a false alarm.
        let part = &scores.parts["one input, one output"];
        let figure = |what: &str| part.iter().find(|t| t.what.ends_with(what)).map(|t| (t.found, t.of)).unwrap();
        assert_eq!(scores.parts.len(), 1);
        assert_eq!(figure("false alarms on none"), (Some(1.0), 1));
        assert_eq!(figure("own equation: exactly named"), (None, 0));
        assert_eq!(figure("confident and wrong, of all cases"), (Some(0.0), 2));
        // One target is missed, and another has no case in this trial.
        let target = |what: &str| scores.targets.iter().find(|t| t.what.starts_with(what)).unwrap();
        assert_eq!(target("false alarms").reached, Some(false));
        assert_eq!((target("outsiders").reached, target("outsiders").of), (None, 0));
        assert_eq!(
            target("active, 3 x 3, single effects of 2 % and more, near miss in shape: exactly").reached,
            Some(true)
        );
    }

    #[test]
    fn bins_are_said_in_words() {
        assert_eq!([gap_bin(0), gap_bin(1), gap_bin(5)], ["below 1 %", "1 % to 2 %", "from 16 %"]);
    }
}
