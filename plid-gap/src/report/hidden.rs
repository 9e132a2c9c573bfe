//! Whether a linear refit would hide the gap: said in words, since such a model looks right on these records.

use super::words::percent;
use crate::diagnose::Outcome;
use crate::judge::gap::shrink;
use crate::judge::verdict::Verdict;

/// A refit that closes this share of the gap hides it.
const MOST: f64 = 0.5;

/// The sentence, if a refit hides the gap.
pub(super) fn sentence(outcome: &Outcome) -> Option<String> {
    let gap = &outcome.diagnosis.gap;
    let bounded = shrink(gap.as_given, gap.refit, gap.noise_floor);
    let free = shrink(gap.as_given, gap.free_refit, gap.noise_floor);
    let (share, refitted, how) = if bounded > MOST {
        (bounded, gap.refit, "even within its stated limits")
    } else if free > MOST {
        (free, gap.free_refit, "let free of its limits")
    } else {
        return None;
    };
    let hides = format!(
        "A linear refit hides most of this gap: the linear simulation alone, refitted {how}, comes down from {} to {} ({} of the shrink that noise allows)",
        percent(gap.as_given),
        percent(refitted),
        percent(share)
    );
    match outcome.diagnosis.verdict {
        Verdict::None => None,
        // Its own numbers are what is wrong: a refit is right to change them.
        Verdict::Effects if outcome.diagnosis.effects.iter().all(|effect| effect.change.is_some()) => None,
        Verdict::Unknown => Some(format!(
            "{hides}. That does not make the cause linear: a refitted model fits the levels and the time of these records, and may fail at others."
        )),
        Verdict::Effects if outcome.shown.linear => {
            Some(format!("{hides}. It would put into modes and shapes what belongs to the effect named above."))
        }
        Verdict::Effects => Some(format!(
            "{hides}, although what is missing is not linear: such a model fits the levels of these records and fails at others."
        )),
    }
}
