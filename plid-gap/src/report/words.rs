//! Numbers and names in the report.

use crate::answer::schema::{Explanation, Located};
use crate::answer::statements::of_records;
use crate::diagnose::Outcome;
use crate::judge::verdict::Verdict;

/// Formats a share, "12.3 %", with a non-breaking space.
pub(super) fn percent(share: f64) -> String {
    plid_report::percent(share).replace(' ', "\u{a0}")
}

/// Formats a number with two significant digits, without an exponent if possible.
pub(super) fn short(value: f64) -> String {
    if !value.is_finite() {
        return "–".into();
    }
    let size = value.abs();
    if size >= 100.0 || size == 0.0 {
        format!("{value:.0}")
    } else if size >= 0.01 {
        format!(
            "{value:.*}",
            if size >= 10.0 {
                0
            } else if size >= 1.0 {
                1
            } else {
                2
            }
        )
    } else {
        format!("{value:.1e}")
    }
}

/// Names an effect: "cubic-stiffness at input:u2".
pub(super) fn at(effect: &str, location: &str) -> String {
    format!("{effect} at {location}")
}

/// Names an explanation.
pub(super) fn explanation(explanation: &Explanation) -> String {
    let one = |located: &Located| at(&located.effect, &located.location);
    let effects = match (explanation.unknown, explanation.effects.is_empty()) {
        (true, _) => "something outside the vocabulary".into(),
        (false, true) => "nothing is missing".into(),
        (false, false) => explanation.effects.iter().map(one).collect::<Vec<_>>().join(" and "),
    };
    match &explanation.wiring {
        Some(wiring) => format!("{effects} ({wiring})"),
        None => effects,
    }
}

/// Names the simulation after the refit or with the effects.
pub(super) fn with(outcome: &Outcome) -> &'static str {
    match (outcome.diagnosis.verdict, outcome.diagnosis.effects.len()) {
        (Verdict::None, _) => "after the bounded refit",
        (Verdict::Unknown, _) => "with the best explanation",
        (Verdict::Effects, 1) => "with the effect",
        (Verdict::Effects, _) => "with the effects",
    }
}

/// Returns the output with the largest share of the gap.
pub(super) fn worst(outcome: &Outcome) -> usize {
    let share = &outcome.shown.before.share;
    (0..share.nrows()).max_by(|&a, &b| share.row(a).sum().total_cmp(&share.row(b).sum())).unwrap_or(0)
}

/// Returns whether the gaps were measured on held-out records.
pub(super) fn held_out(outcome: &Outcome) -> bool {
    !outcome.diagnosis.gap.measured_on_fitted
}

/// Says in a sentence what else the records were used for on which the gaps were measured.
pub(super) fn records(outcome: &Outcome) -> String {
    let gap = &outcome.diagnosis.gap;
    of_records(&gap.measured_on, gap.measured_on_fitted)
}

/// Keeps the numbers of a sentence together with their per cent signs.
pub(super) fn unbroken(sentence: &str) -> String {
    sentence.replace(" %", "\u{a0}%")
}

/// States the earlier use of the records on which the gaps were measured.
pub(super) fn kind(outcome: &Outcome) -> &'static str {
    if held_out(outcome) {
        "held out from all fitting, but used by the verdict"
    } else {
        "a fitted record, because nothing could be held out"
    }
}

#[cfg(test)]
mod tests {
    use super::{percent, short};

    #[test]
    fn numbers_are_short_and_zero_has_no_sign() {
        let shares = [0.1234, 0.0012, -1e-9, 0.0, f64::NAN, 1.0];
        let texts = ["12.3\u{a0}%", "0.12\u{a0}%", "0\u{a0}%", "0\u{a0}%", "–", "100.0\u{a0}%"];
        assert_eq!(shares.map(percent), texts);
        assert_eq!([0.3, 12.34, 1234.5, 1.5e-5, 0.0].map(short), ["0.30", "12", "1234", "1.5e-5", "0"]);
    }
}
