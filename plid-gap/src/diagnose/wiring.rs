//! The decision whether channels are exchanged, negated, delayed or in other units, or whether effects explain the
//! records as they are.
//!
//! The audit finds such a mismatch before anything is fitted. It is a hypothesis: the case is diagnosed with the
//! mismatch corrected and as it was recorded, and the gaps that remain on the same records decide.

use crate::answer::schema::{Diagnosis, Explanation, NamedEffect};
use crate::diagnose::Outcome;
use crate::settings::AuditSettings;
use plid_report::percent;

/// Returns the probability that the mismatch is real, from the gaps that the two diagnoses leave. The squared gaps are
/// treated as mean squares of a given number of independent values.
fn probability(corrected: &Diagnosis, recorded: &Diagnosis, settings: &AuditSettings) -> f64 {
    // Below the noise, a difference between gaps is due to chance.
    let left = |one: &Diagnosis| one.gap.with_effect.max(one.gap.noise_floor).max(f64::MIN_POSITIVE);
    let ratio = left(corrected) / left(recorded);
    // A model that diverges explains nothing.
    let odds = if ratio.is_nan() { 1.0 } else { ratio.powf(-settings.wiring_values) };
    let odds = settings.wiring_odds * odds;
    1.0 - 1.0 / (1.0 + odds)
}

/// Returns the more probable of the two outcomes, with the explanations of the other one added, and whether it is the
/// corrected one. `said` is the sentence on the mismatch.
pub(super) fn decided(corrected: Outcome, recorded: Outcome, said: &str, settings: &AuditSettings) -> (Outcome, bool) {
    let probability = probability(&corrected.diagnosis, &recorded.diagnosis, settings);
    let gaps = [&corrected, &recorded].map(|outcome| percent(outcome.diagnosis.gap.with_effect));
    let is_real = probability >= 0.5;
    let (mut first, other) = if is_real { (corrected, recorded) } else { (recorded, corrected) };
    let probability = if is_real { probability } else { 1.0 - probability };
    let probable = match (100.0 * probability).round() {
        100.0.. => "more than 99 %".to_owned(),
        percent => format!("{percent} %"),
    };
    let sentence = &mut first.diagnosis.sentence;
    let [with, without] = &gaps;
    if is_real {
        let why = format!("{said} Its probability is {probable}: without the correction, {without} remains at best.");
        *sentence = sentence.replacen(said, &why, 1);
    } else {
        *sentence += &format!(
            " The channels are taken as they were recorded ({probable} sure): with the apparent mismatch corrected, \
             {with} remains at best, compared with {without}."
        );
    }
    let wiring = if is_real { "channels as recorded" } else { "with the apparent mismatch corrected" };
    merge(&mut first.diagnosis, other.diagnosis, probability, wiring);
    (first, is_real)
}

/// Adds the explanations of the other diagnosis, which has the remaining probability.
fn merge(first: &mut Diagnosis, other: Diagnosis, probability: f64, wiring: &str) {
    first.candidates.iter_mut().for_each(|candidate| candidate.probability *= probability);
    let added = |candidate: Explanation| Explanation {
        probability: (1.0 - probability) * candidate.probability,
        wiring: Some(wiring.to_owned()),
        ..candidate
    };
    let others = other.candidates.into_iter().map(added);
    first.candidates.extend(others);
    first.candidates.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    for effect in &mut first.effects {
        let is = |named: &&NamedEffect| (&named.effect, &named.location) == (&effect.effect, &effect.location);
        let elsewhere = other.effects.iter().find(is).map_or(0.0, |named| named.confidence);
        effect.confidence = probability * effect.confidence + (1.0 - probability) * elsewhere;
    }
}
