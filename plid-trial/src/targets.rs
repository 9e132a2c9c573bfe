//! The targets of a trial and the figures that were reached.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::scores::{ALL, ARM, EQUATION, Group, NEAR, OWN, PART, PARTS, Totals, totals};
use crate::statistics::Rate;

/// A figure and its target.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Target {
    /// Name of the figure.
    pub what: String,
    /// Whether `bound` is a lower bound; otherwise it is an upper bound.
    pub at_least: bool,
    /// The bound.
    pub bound: f64,
    /// The figure found.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub found: Option<f64>,
    /// Its 95 % interval, if it is a share.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ci95: Option<[f64; 2]>,
    /// Number of cases.
    pub of: usize,
    /// Whether the target is reached.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reached: Option<bool>,
}

pub(crate) fn target(what: impl Into<String>, at_least: bool, bound: f64, found: Option<f64>, of: usize) -> Target {
    let reached = found.map(|found| if at_least { found >= bound } else { found <= bound });
    Target { what: what.into(), at_least, bound, found, ci95: None, of, reached }
}

pub(crate) fn share(what: impl Into<String>, at_least: bool, bound: f64, rate: Option<Rate>) -> Target {
    let rate = rate.unwrap_or_else(|| Rate::new(0, 0));
    Target { ci95: rate.ci95, ..target(what, at_least, bound, rate.share, rate.of) }
}

type Reading = fn(&Totals) -> Rate;

/// Figures of single effects with their lower bounds, for the vocabulary's own equation and for near misses. As many
/// must be exactly named as in the first draw of the standard trial that was scored.
const SINGLES: [(&str, Reading, [f64; 2]); 4] = [
    ("exactly named", |t| t.exact, [117.0 / 120.0, 49.0 / 56.0]),
    ("right family", |t| t.family, [0.95, 0.90]),
    ("right name and place", |t| t.located, [0.80, 0.75]),
    ("in the 95 % set", |t| t.in_set, [0.95, 0.90]),
];

/// The single effects to which the targets apply.
pub(crate) const WHOLE: &str = "active, 3 x 3";

/// Largest share of false alarms: that of the same draw.
const FALSE: f64 = 3.0 / 216.0;

/// Largest share of confident wrong names over all cases: that of the same draw.
const WRONG: f64 = 5.0 / 908.0;

/// Largest share of confident wrong names with reduced records, where the power may be lower.
const WRONG_REDUCED: f64 = 0.05;

/// Least share of outsiders that are kept open: that of the same draw.
const OPEN: f64 = 58.0 / 64.0;

/// Returns the figures of some cases. `of` finds their groups: [`OWN`], [`NEAR`], [`ALL`] or the name of an arm;
/// `singles` and `rest` precede the names of the figures.
fn figures<'a>(singles: &str, rest: &str, of: &dyn Fn(&str) -> Option<&'a Totals>) -> Vec<Target> {
    let mut figures = Vec::new();
    for (k, (is, equation)) in [(OWN, "own equation"), (NEAR, "near miss in shape")].into_iter().enumerate() {
        let here = of(is);
        let asked = format!("{singles}, single effects of 2 % and more, {equation}");
        for (what, reading, bounds) in SINGLES {
            figures.push(share(format!("{asked}: {what}"), true, bounds[k], here.map(reading)));
        }
        let (found, count) = here.map_or((None, 0), |t| (t.shrink_median, t.shrink_of));
        let what = format!("{asked}: median held-out shrink, rightly named");
        figures.push(target(what, true, [0.9, 0.8][k], found, count));
    }
    let all = of(ALL);
    figures.push(share(format!("{rest}false alarms on none"), false, FALSE, of("none").map(|t| t.false_alarms)));
    figures.push(share(
        format!("{rest}confident and wrong, of all cases"),
        false,
        WRONG,
        all.map(|t| t.confident_wrong),
    ));
    figures.push(share(format!("{rest}outsiders kept open"), true, OPEN, of("outsider").map(|t| t.kept_open)));
    let what = format!("{rest}stated gap within 5 % of the gap as given, rightly named");
    figures.push(share(what, true, 0.9, all.map(|t| t.stated_rightly)));
    let error = all.and_then(|t| t.calibration.expected_error);
    let what = format!("{rest}expected calibration error");
    figures.push(target(what, false, 0.05, error, all.map_or(0, |t| t.calibration.of)));
    figures.push(share(format!("{rest}pairs: both named"), true, 0.75, of("pair").map(|t| t.all_named)));
    figures.push(share(format!("{rest}triples: all named"), true, 0.55, of("triple").map(|t| t.all_named)));
    figures
}

/// Returns the targets of a trial.
pub(crate) fn targets(groups: &[Group]) -> Vec<Target> {
    let of = |is: &str| match is {
        OWN | NEAR => totals(groups, EQUATION, is, 0),
        ALL => totals(groups, ALL, ALL, 0),
        arm => totals(groups, ARM, arm, 0),
    };
    let mut targets = figures(WHOLE, "", &of);
    for part in ["passive", "one input, one output"] {
        let rate = totals(groups, &format!("{PART}{part}"), ALL, 0).map(|t| t.confident_wrong);
        targets.push(share(format!("{part}: confident and wrong"), false, WRONG_REDUCED, rate));
    }
    targets
}

/// Returns the figures of each part of a trial that has cases. Power may be lower in a part: the bounds are those of
/// the whole trial, for comparison.
pub(crate) fn parts(groups: &[Group]) -> BTreeMap<&'static str, Vec<Target>> {
    let of = |part: &str, is: &str| totals(groups, &format!("{PART}{part}"), is, 0);
    let there = PARTS.iter().filter(|(part, _)| of(part, ALL).is_some());
    there.map(|(part, _)| (*part, figures(part, &format!("{part}: "), &|is| of(part, is)))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scores::ANSWERERS;

    /// Returns a group of a trial with these totals of the diagnosis.
    fn group(by: &str, is: &str, change: impl FnOnce(&mut Totals)) -> Group {
        let mut totals = Totals::of(std::iter::empty(), 0);
        change(&mut totals);
        Group { by: by.to_owned(), is: is.to_owned(), totals: vec![totals; ANSWERERS.len()] }
    }

    /// The figures of the draw from which bounds were taken reach these bounds, and one case less does not. Its pairs
    /// and triples do not reach theirs.
    #[test]
    fn the_bounds_are_those_of_the_scored_draw() {
        let reached = |worse: usize| -> Vec<Option<bool>> {
            let groups = [
                group(EQUATION, OWN, |t| t.exact = Rate::new(117 - worse, 120)),
                group(EQUATION, NEAR, |t| t.exact = Rate::new(49 - worse, 56)),
                group(ALL, ALL, |t| t.confident_wrong = Rate::new(5 + worse, 908)),
                group(ARM, "none", |t| t.false_alarms = Rate::new(3 + worse, 216)),
                group(ARM, "outsider", |t| t.kept_open = Rate::new(58 - worse, 64)),
                group(ARM, "pair", |t| t.all_named = Rate::new(40, 60)),
                group(ARM, "triple", |t| t.all_named = Rate::new(10, 24)),
                group(&format!("{PART}passive"), ALL, |t| t.confident_wrong = Rate::new(4, 100)),
            ];
            let targets = targets(&groups);
            let ends = [
                "own equation: exactly named",
                "near miss in shape: exactly named",
                "confident and wrong, of all cases",
                "false alarms on none",
                "outsiders kept open",
                "pairs: both named",
                "triples: all named",
                "passive: confident and wrong",
            ];
            ends.map(|end| targets.iter().find(|target| target.what.ends_with(end)).unwrap().reached).to_vec()
        };
        let of = |draw: bool| [vec![Some(draw); 5], vec![Some(false), Some(false), Some(true)]].concat();
        assert_eq!(reached(0), of(true));
        assert_eq!(reached(1), of(false));
    }
}
