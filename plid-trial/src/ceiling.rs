//! The ceiling: the gap that a model without physics, the black box, leaves on held-out records, in comparison with
//! that of plid's answer.

use std::collections::BTreeSet;

use serde::Serialize;

use crate::judge::Asked;
use crate::scores::Line;
use crate::statistics::{Rate, median};
use crate::vocabulary::family;

/// Median gaps of held-out records over some cases that have a black box.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Ceiling {
    /// The description of the cases.
    pub is: String,
    /// Number of cases.
    pub cases: usize,
    /// The gap of the simulation as given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub as_given: Option<f64>,
    /// The gap that plid's answer leaves, whatever it names. An answer that predicts nothing leaves the gap as given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub diagnosis: Option<f64>,
    /// The gap that the black box leaves.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub black_box: Option<f64>,
    /// The gap that imperfections and noise make without the main effects; without imperfections, that of noise alone.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub background: Option<f64>,
    /// The cases in which plid's answer leaves no more than the black box.
    pub diagnosis_is_closer: Rate,
}

/// The cases with one or more effects of the vocabulary.
pub const VOCABULARY: &str = "effects of the vocabulary";
/// The cases with a cause outside it.
pub const OUTSIDE: &str = "a cause outside it";
/// The cases with nothing missing, imperfections aside.
pub const NONE: &str = "nothing missing";

impl Ceiling {
    fn of(is: &str, lines: &[(&Line, f64)]) -> Self {
        let left = |line: &Line| line.judged[0].gap.unwrap_or(line.gap_as_given);
        let of = |read: &dyn Fn(&Line) -> f64| median(&lines.iter().map(|(line, _)| read(line)).collect::<Vec<_>>());
        Self {
            is: is.to_owned(),
            cases: lines.len(),
            as_given: of(&|line| line.gap_as_given),
            diagnosis: of(&left),
            black_box: median(&lines.iter().map(|(_, gap)| *gap).collect::<Vec<_>>()),
            background: of(&|line| line.gap_background.unwrap_or(line.gap_floor)),
            diagnosis_is_closer: Rate::of(lines.iter().map(|(line, gap)| left(line) <= *gap)),
        }
    }
}

/// Returns the medians over the effects of the vocabulary, over each family of single effects, over the causes outside
/// the vocabulary and over the cases with nothing missing. Second answers are not counted.
pub(crate) fn groups(lines: &[Line]) -> Vec<Ceiling> {
    let first = lines.iter().filter(|line| line.without.is_empty());
    let known: Vec<(&Line, f64)> = first.filter_map(|line| Some((line, line.gap_black_box?))).collect();
    let mut groups = Vec::new();
    let mut add = |is: &str, keep: &dyn Fn(&Line) -> bool| {
        let these: Vec<(&Line, f64)> = known.iter().copied().filter(|(line, _)| keep(line)).collect();
        if !these.is_empty() {
            groups.push(Ceiling::of(is, &these));
        }
    };
    add(VOCABULARY, &|line| matches!(line.asked, Asked::Single | Asked::Several));
    let families: BTreeSet<&str> = known.iter().filter_map(|(line, _)| family(&line.truth)).collect();
    for name in families {
        add(name, &|line| line.asked == Asked::Single && family(&line.truth) == Some(name));
    }
    add(OUTSIDE, &|line| line.asked == Asked::Outside);
    add(NONE, &|line| line.asked == Asked::None);
    groups
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::judge::Judged;
    use crate::plan::Arm;

    fn line(truth: &str, asked: Asked, plid: Option<f64>, black_box: Option<f64>) -> Line {
        let judged = |gap| Judged { gap, ..Judged::default() };
        Line {
            case: "case-1".to_owned(),
            arm: Arm::Single,
            asked,
            truth: truth.to_owned(),
            gap: 0.1,
            own_equation: true,
            without: Vec::new(),
            gap_as_given: 0.1,
            gap_floor: 0.01,
            gap_background: None,
            gap_black_box: black_box,
            nuisances: BTreeMap::new(),
            failed: None,
            covered: BTreeMap::new(),
            judged: [judged(plid), judged(None), judged(None), judged(None)],
        }
    }

    #[test]
    fn medians_are_of_the_cases_that_have_a_black_box() {
        let mut lines = vec![
            line("clearance", Asked::Single, Some(0.02), Some(0.03)),
            line("clearance", Asked::Single, Some(0.05), Some(0.04)),
            // Without a prediction, the gap is that of the simulation as given.
            line("sensor-gain", Asked::Single, None, Some(0.02)),
            line("sensor-gain", Asked::Single, Some(0.03), None),
            line("x-backlash", Asked::Outside, Some(0.09), Some(0.05)),
        ];
        lines.push(Line { without: vec!["clearance".to_owned()], ..lines[0].clone() });
        lines[1].gap_background = Some(0.02);
        let groups = groups(&lines);
        let names: Vec<(&str, usize)> = groups.iter().map(|group| (group.is.as_str(), group.cases)).collect();
        let expected = [(VOCABULARY, 3), ("sensor-linear", 1), ("structure-nonlinear", 2), (OUTSIDE, 1)];
        assert_eq!(names, expected);
        let all = &groups[0];
        assert_eq!((all.as_given, all.diagnosis, all.black_box), (Some(0.1), Some(0.05), Some(0.03)));
        assert_eq!((all.background, all.diagnosis_is_closer.hits), (Some(0.01), 1));
    }
}
