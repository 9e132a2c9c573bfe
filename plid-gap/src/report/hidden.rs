//! States whether a linear refit would hide the gap, because the refitted model would look right on these records.

use super::words::percent;
use crate::diagnose::Outcome;
use crate::judge::gap::shrink;
use crate::judge::verdict::Verdict;

/// Returns the sentence, if a refit hides the gap.
pub(super) fn sentence(outcome: &Outcome) -> Option<String> {
    let gap = &outcome.diagnosis.gap;
    let bounded = shrink(gap.as_given, gap.refit, gap.noise_floor);
    let free = shrink(gap.as_given, gap.free_refit, gap.noise_floor);
    let least = outcome.diagnosis.settings.answer.hidden_by_refit;
    let (share, refitted, how) = if bounded > least {
        (bounded, gap.refit, "even within its stated limits")
    } else if free > least {
        (free, gap.free_refit, "without limits")
    } else {
        return None;
    };
    let hides = format!(
        "A linear refit hides most of this gap: refitting the linear simulation {how} reduces it from {} to {} ({} of \
        the shrink that noise allows)",
        percent(gap.as_given),
        percent(refitted),
        percent(share)
    );
    match outcome.diagnosis.verdict {
        Verdict::None => None,
        // If parameters of the simulation are wrong, a refit is right to change them.
        Verdict::Effects if outcome.diagnosis.effects.iter().all(|effect| effect.change.is_some()) => None,
        Verdict::Unknown => Some(format!(
            "{hides}. That does not make the cause linear: a refitted model fits the levels and the time of these \
            records, and may fail at others."
        )),
        Verdict::Effects if outcome.shown.linear => {
            Some(format!("{hides}. It would attribute the effect named above to modes and shapes."))
        }
        Verdict::Effects => Some(format!(
            "{hides}, although the missing effect is nonlinear: such a model fits the levels of these records and \
            fails at others."
        )),
    }
}
