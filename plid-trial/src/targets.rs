//! What is to be reached, and what was.

use serde::Serialize;

use crate::scores::{ALL, ARM, EQUATION, Group, NEAR, OWN, Totals, totals};
use crate::statistics::Rate;

/// A figure with what it is to be.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Target {
    /// Of what.
    pub what: String,
    /// Whether it is to be at least `bound`, or at most.
    pub at_least: bool,
    /// The bound.
    pub bound: f64,
    /// What was found.
    pub found: Option<f64>,
    /// Its 95 % interval, where it is a share.
    pub ci95: Option<[f64; 2]>,
    /// Of how many cases.
    pub of: usize,
    /// Whether the bound is kept.
    pub reached: Option<bool>,
}

fn target(what: impl Into<String>, at_least: bool, bound: f64, found: Option<f64>, of: usize) -> Target {
    let reached = found.map(|found| if at_least { found >= bound } else { found <= bound });
    Target { what: what.into(), at_least, bound, found, ci95: None, of, reached }
}

fn share(what: impl Into<String>, at_least: bool, bound: f64, rate: Option<Rate>) -> Target {
    let rate = rate.unwrap_or_else(|| Rate::new(0, 0));
    Target { ci95: rate.ci95, ..target(what, at_least, bound, rate.share, rate.of) }
}

type Reading = fn(&Totals) -> Rate;

/// Readings of single effects with their bounds: the own equation, a near miss.
const SINGLES: [(&str, Reading, [f64; 2]); 4] = [
    ("exactly named", |t| t.exact, [0.85, 0.70]),
    ("right family", |t| t.family, [0.95, 0.90]),
    ("right name and place", |t| t.located, [0.80, 0.75]),
    ("in the 95 % set", |t| t.in_set, [0.95, 0.90]),
];

/// The targets of a trial.
pub(crate) fn targets(groups: &[Group]) -> Vec<Target> {
    let of = |by: &str, is: &str| totals(groups, by, is, 0);
    let mut targets = Vec::new();
    for (k, is) in [OWN, NEAR].into_iter().enumerate() {
        let here = of(EQUATION, is);
        let equation = if is == OWN { "own equation" } else { "near miss in shape" };
        for (what, reading, bounds) in SINGLES {
            let what = format!("single effects of 2 % and more, {equation}: {what}");
            targets.push(share(what, true, bounds[k], here.map(reading)));
        }
        let what = format!("single effects of 2 % and more, {equation}: median held-out shrink, rightly named");
        let (found, count) = here.map_or((None, 0), |t| (t.shrink_median, t.shrink_of));
        targets.push(target(what, true, [0.9, 0.8][k], found, count));
    }
    let all = of(ALL, ALL);
    targets.push(share("false alarms on none", false, 0.02, of(ARM, "none").map(|t| t.false_alarms)));
    targets.push(share("confident and wrong, of all cases", false, 0.05, all.map(|t| t.confident_wrong)));
    targets.push(share("outsiders kept open", true, 0.75, of(ARM, "outsider").map(|t| t.kept_open)));
    targets.push(share(
        "stated gap within 5 % of the gap as given, rightly named",
        true,
        0.9,
        all.map(|t| t.stated_rightly),
    ));
    let error = all.and_then(|t| t.calibration.expected_error);
    targets.push(target("expected calibration error", false, 0.05, error, all.map_or(0, |t| t.calibration.of)));
    targets.push(share("pairs: both named", true, 0.5, of(ARM, "pair").map(|t| t.all_named)));
    targets
}
