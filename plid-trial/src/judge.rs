//! Judges one answer against the truth by fixed rules, which the chapter "Can it be trusted?" defines. The tests go
//! through them case by case.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::truth::Truth;
use crate::vocabulary::family;

/// Smallest probability at which an effect counts as named with confidence.
pub const CONFIDENT: f64 = 0.9;
/// Smallest probability at which a named effect counts as likely.
pub const LIKELY: f64 = 0.5;
/// Smallest probability of something else at which an answer keeps a cause outside the vocabulary open.
pub const OPEN: f64 = 0.2;
/// Probability that the set of explanations must reach.
pub const COVER: f64 = 0.95;

/// An answer: the keys of diagnosis.json that a score reads. Baselines answer in the same form.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Claim {
    /// "effects", "none" or "unknown"; "missing" without an answer.
    pub verdict: String,
    /// The effects of the answer, largest first.
    #[serde(default)]
    pub effects: Vec<Named>,
    /// All explanations.
    #[serde(default)]
    pub candidates: Vec<Candidate>,
    /// The statements about the gap.
    #[serde(default)]
    pub gap: Stated,
    /// The statement about the remainder.
    #[serde(default)]
    pub remainder: Remains,
}

/// A named effect.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Named {
    /// The name of the effect.
    pub effect: String,
    /// Its location.
    #[serde(default)]
    pub location: String,
    /// Probability that it is at work there.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub confidence: Option<f64>,
    /// The parameters by name.
    #[serde(default)]
    pub parameters: BTreeMap<String, Stretch>,
    /// Whether the shape of the effect differs from that of its equation.
    #[serde(default)]
    pub shape_differs: bool,
}

/// A parameter's interval.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Stretch {
    /// The 95 % interval.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ci95: Option<[Option<f64>; 2]>,
}

/// An explanation.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Candidate {
    /// The effects; empty if nothing is missing, and for something else.
    #[serde(default)]
    pub effects: Vec<Named>,
    /// Whether it is "something else".
    #[serde(default)]
    pub unknown: bool,
    /// The probability; those of all explanations add up to one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub probability: Option<f64>,
}

/// The statements about the gap.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Stated {
    /// The gap predicted before the held-out record was seen.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub predicted_held_out_gap: Option<f64>,
    /// The 80 % interval of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub predicted_ci80: Option<[Option<f64>; 2]>,
}

/// The statement about the remainder.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Remains {
    /// The probability of a further cause above `material`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub further_cause: Option<f64>,
    /// The gap that counts as material.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub material: Option<f64>,
}

impl Claim {
    /// Returns a missing answer.
    pub fn missing() -> Self {
        Self { verdict: "missing".to_owned(), ..Self::default() }
    }

    /// Returns the effects of the answer; the list is empty unless the verdict is "effects".
    pub fn said(&self) -> &[Named] {
        if self.verdict == "effects" { &self.effects } else { &[] }
    }
}

/// The questions that a case can ask.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Asked {
    /// Nothing is missing.
    None,
    /// One effect of the vocabulary.
    Single,
    /// Several effects.
    Several,
    /// An effect that is not in the vocabulary.
    Outside,
}

/// Returns the question of a case for a diagnosis whose vocabulary lacks `without`.
pub fn asked(truth: &Truth, without: &[String]) -> Asked {
    let outside = |name: &str| name.starts_with("x-") || without.iter().any(|lacks| lacks == name);
    if truth.at_work().any(|effect| outside(&effect.effect)) {
        return Asked::Outside;
    }
    match truth.at_work().count() {
        0 => Asked::None,
        1 => Asked::Single,
        _ => Asked::Several,
    }
}

/// The judgement on an answer.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Judged {
    /// The names in alphabetical order, or the verdict.
    pub said: String,
    /// The first place stated.
    pub at: String,
    /// Whether an effect was named, whatever the truth is.
    pub named: bool,
    /// Whether the single effect was named, and no other.
    pub exact: bool,
    /// Whether the first effect named is of the right family.
    pub family: bool,
    /// Whether the first effect named is right and at its place.
    pub located: bool,
    /// Whether the truth with its places is in the 95 % set.
    pub in_set: bool,
    /// Number of explanations in that set.
    pub set_size: usize,
    /// Whether all of several effects were named, and no other.
    pub all_named: bool,
    /// Whether an effect was named that does not act.
    pub spurious: bool,
    /// Whether the verdict is unknown, or something else has a sufficient probability.
    pub open: bool,
    /// Whether the verdict is unknown.
    pub unknown: bool,
    /// Whether the first effect is named with confidence.
    pub confident: bool,
    /// Whether the first effect is named with confidence and is wrong.
    pub wrong: bool,
    /// Whether the first effect named is right and stated to differ in shape.
    pub shape_differs: bool,
    /// The probability of the first explanation, and whether it is the truth.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub top: Option<(f64, bool)>,
    /// The probability of the explanation to which the verdict refers, and whether it is the truth. It is the likeliest
    /// one that contains the first effect named, the one without effects, or something else.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub explanation: Option<(f64, bool)>,
    /// Whether all names are right.
    pub right: bool,
    /// Gap on the held-out record with the simulation of the answer, if there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gap: Option<f64>,
    /// One minus the ratio of the gap with the answer to the gap as given, both beyond the floor; zero without a
    /// prediction.
    pub shrink: f64,
    /// Whether the gap as given clearly exceeds the floor, so that it can shrink.
    pub shrinkable: bool,
    /// Difference between the stated and the realised gap, relative to the gap as given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub missed_by: Option<f64>,
    /// Whether the first effect named is the main cause, the largest one that acts.
    pub main_first: bool,
    /// Whether the main cause is among the effects named.
    pub main_named: bool,
    /// Whether the main cause is named first, at its place.
    pub main_located: bool,
    /// Whether an effect that does not act is named with a probability of [`LIKELY`] or more.
    pub likely_wrong: bool,
    /// Whether the stated gap is within a quarter of the one found.
    pub stated_near: bool,
    /// Whether the stated 80 % interval contains the gap found.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub in_ci80: Option<bool>,
    /// For each effect named: its probability, and whether it acts at its place.
    pub statements: Vec<(f64, bool)>,
    /// The stated probability of a further cause, and whether there is one: a cause that the answer does not name and
    /// that makes more than a material gap.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub further_cause: Option<(f64, bool)>,
}

/// Returns whether a list of effects is the truth: each at its place and nothing else, imperfections aside. If the
/// truth has only imperfections, some of them are the truth as well.
fn same(truth: &Truth, effects: &[Named]) -> bool {
    let there =
        |e: &crate::truth::TrueEffect| effects.iter().any(|said| said.effect == e.effect && e.is_at(&said.location));
    let main = |said: &Named| truth.at_work().any(|e| said.effect == e.effect && e.is_at(&said.location));
    let beside =
        effects.iter().filter(|said| !main(said) && truth.has_background(&said.effect, &said.location)).count();
    truth.at_work().count() + beside == effects.len() && truth.at_work().all(there)
}

/// Joins names in alphabetical order.
fn joined<'a>(names: impl Iterator<Item = &'a str>) -> String {
    let mut names: Vec<&str> = names.collect();
    names.sort_unstable();
    names.join("+")
}

/// Returns the names of the effects that act, or "none".
pub fn wanted(truth: &Truth) -> String {
    let names: std::collections::BTreeSet<&str> = truth.at_work().map(|e| e.effect.as_str()).collect();
    if names.is_empty() { "none".to_owned() } else { joined(names.into_iter()) }
}

fn probability(candidate: &Candidate) -> f64 {
    candidate.probability.unwrap_or(0.0)
}

/// Returns the candidates, the likeliest first.
fn by_probability(candidates: &[Candidate]) -> Vec<&Candidate> {
    let mut order: Vec<&Candidate> = candidates.iter().collect();
    order.sort_by(|a, b| probability(b).total_cmp(&probability(a)));
    order
}

/// Returns the likeliest candidates that together reach the probability [`COVER`], and their probability.
fn credible_set<'a>(order: &[&'a Candidate]) -> (Vec<&'a Candidate>, f64) {
    let mut mass = 0.0;
    let mut set = Vec::new();
    for candidate in order {
        if mass >= COVER {
            break;
        }
        set.push(*candidate);
        mass += probability(candidate);
    }
    (set, mass)
}

/// Returns the share of the gap beyond the floor that a correction with the remaining gap `gap` removes.
fn shrink(truth: &Truth, gap: f64) -> f64 {
    let (given, floor) = (truth.gap_sim, truth.gap_floor);
    let beyond = |gap: f64| (gap * gap - floor * floor).max(0.0);
    1.0 - (beyond(gap) / (given * given - floor * floor).max(1e-12)).sqrt()
}

/// Returns the probability of a candidate, and whether it is the truth. If only imperfections are at work, "something
/// else" is true as well, because no effect of the vocabulary makes their gap.
fn outcome(candidate: &Candidate, truth: &Truth, outside: bool) -> Option<(f64, bool)> {
    let imperfections = truth.gap_background.is_some() && truth.main().is_none();
    let hit = if candidate.unknown { outside || imperfections } else { !outside && same(truth, &candidate.effects) };
    Some((candidate.probability?, hit))
}

/// Returns the likeliest candidate to which the verdict refers: one with the first effect named, the one without
/// effects, or something else.
fn of_verdict<'a>(order: &[&'a Candidate], claim: &Claim) -> Option<&'a Candidate> {
    let first = claim.said().first();
    let has = |effects: &[Named]| {
        first.is_some_and(|first| effects.iter().any(|e| e.effect == first.effect && e.location == first.location))
    };
    let is = |one: &&&Candidate| match claim.verdict.as_str() {
        "unknown" => one.unknown,
        "none" => !one.unknown && one.effects.is_empty(),
        _ => has(&one.effects),
    };
    order.iter().find(is).copied()
}

/// Returns the stated probability of a further cause, and whether there is one. `None` if the answer does not state it,
/// or the label does not tell.
fn further_cause(truth: &Truth, claim: &Claim) -> Option<(f64, bool)> {
    let Remains { further_cause, material } = claim.remainder;
    let is_named = |cause: &crate::truth::TrueEffect| {
        claim.said().iter().any(|said| said.effect == cause.effect && cause.is_at(&said.location))
    };
    Some((further_cause?, truth.has_further_cause(material?, is_named)?))
}

/// Judges an answer; `realised` is the gap of its simulation on the held-out record.
pub fn judge(truth: &Truth, without: &[String], claim: &Claim, realised: Option<f64>) -> Judged {
    let outside = asked(truth, without) == Asked::Outside;
    let is_named = |name: &str| truth.at_work().any(|e| e.effect == name);
    let is_small = |said: &Named| truth.has_background(&said.effect, &said.location);
    let is_at_work = |said: &Named| is_named(&said.effect) || is_small(said);
    let said = claim.said();
    let first = said.first();
    let order = by_probability(&claim.candidates);
    let (set, mass) = credible_set(&order);
    let right_name = first.is_some_and(|said| is_named(&said.effect));
    let small_first = first.is_some_and(is_small);
    let is_likely = |said: &Named| said.confidence.unwrap_or(0.0) >= LIKELY;
    let is_main = |said: &Named| truth.main().is_some_and(|main| main.effect == said.effect);
    let at_its_place = |said: &Named| truth.at_work().any(|e| e.effect == said.effect && e.is_at(&said.location));
    let confident = first.is_some_and(|said| said.confidence.unwrap_or(0.0) >= CONFIDENT);
    let families: Vec<_> = truth.at_work().map(|e| family(&e.effect)).collect();
    let text = if said.is_empty() { claim.verdict.clone() } else { joined(said.iter().map(|s| s.effect.as_str())) };
    let without_small = || said.iter().filter(|said| is_named(&said.effect) || !is_small(said));
    let names = joined(without_small().map(|said| said.effect.as_str()));
    let right = if names.is_empty() { said.is_empty() && text == wanted(truth) } else { names == wanted(truth) };
    let unknown = claim.verdict == "unknown";
    let (given, floor) = (truth.gap_sim, truth.gap_floor);
    let stated = claim.gap.predicted_held_out_gap;
    Judged {
        at: first.map(|said| said.location.clone()).unwrap_or_default(),
        named: !said.is_empty(),
        exact: right_name && without_small().count() == 1,
        family: first.is_some_and(|said| families.contains(&family(&said.effect))) && !families.is_empty(),
        located: first.is_some_and(at_its_place),
        in_set: mass > 0.0 && set.iter().any(|c| same(truth, &c.effects)),
        set_size: set.len(),
        all_named: said.iter().all(is_at_work)
            && truth.at_work().all(|e| said.iter().any(|said| said.effect == e.effect)),
        spurious: !said.iter().all(is_at_work),
        open: unknown || order.iter().any(|c| c.unknown && probability(c) >= OPEN),
        unknown,
        confident,
        wrong: confident && (outside || !right_name) && !small_first,
        shape_differs: right_name && first.is_some_and(|said| said.shape_differs),
        top: order.first().and_then(|top| outcome(top, truth, outside)),
        explanation: of_verdict(&order, claim).and_then(|one| outcome(one, truth, outside)),
        right,
        gap: realised,
        shrink: realised.map_or(0.0, |gap| shrink(truth, gap)),
        shrinkable: given > 1.5 * floor,
        missed_by: stated.zip(realised).map(|(stated, found)| (stated - found).abs() / given),
        main_first: first.is_some_and(is_main),
        main_named: said.iter().any(is_main),
        main_located: first.is_some_and(|said| truth.is_main(&said.effect, &said.location)),
        likely_wrong: said.iter().any(|said| is_likely(said) && !is_at_work(said)),
        stated_near: stated.zip(realised).is_some_and(|(stated, found)| (stated / found - 1.0).abs() <= 0.25),
        in_ci80: claim.gap.predicted_ci80.and_then(|[low, high]| Some((low?..=high?).contains(&realised?))),
        statements: said
            .iter()
            .filter_map(|said| Some((said.confidence?, at_its_place(said) || is_small(said))))
            .collect(),
        further_cause: further_cause(truth, claim),
        said: text,
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn truth(effects: serde_json::Value) -> Truth {
        serde_json::from_value(json!({ "effects": effects, "gap_sim": 0.1, "gap_floor": 0.02 })).unwrap()
    }

    fn effect(name: &str, loc: usize) -> serde_json::Value {
        json!({ "effect": name, "loc": loc, "par": [1.0, 2.0], "gap": 0.08, "hz": 168.0, "own_equation": true })
    }

    fn claim(value: serde_json::Value) -> Claim {
        serde_json::from_value(value).unwrap()
    }

    fn named(effect: &str, location: &str, confidence: f64) -> serde_json::Value {
        json!({ "effect": effect, "location": location, "confidence": confidence })
    }

    fn clearance() -> Truth {
        truth(json!([effect("clearance", 1)]))
    }

    /// One effect is named correctly and first, but together with a wrong one. The truth is second among the
    /// candidates.
    #[test]
    fn a_single_effect_by_the_rules() {
        let (right, wrong) = (named("clearance", "input:u2", 0.93), named("sensor-gain", "output:y1", 0.6));
        let both = json!([right, wrong]);
        let said = claim(json!({
            "verdict": "effects", "effects": both,
            "candidates": [
                { "effects": [], "unknown": true, "probability": 0.1 },
                { "effects": both, "probability": 0.5 },
                { "effects": [right], "probability": 0.36 },
                { "effects": [], "probability": 0.04 },
            ],
            "gap": { "predicted_held_out_gap": 0.03, "as_given": 0.1 },
        }));
        let found = judge(&clearance(), &[], &said, Some(0.03));
        // The first name and its place count; it is exact only if nothing else is named.
        assert!(found.family && found.located && !found.exact && found.spurious && !found.right);
        assert!(found.confident && !found.wrong && !found.open && !found.unknown);
        // 0.5 + 0.36 is below 0.95, so "something else" is the third explanation of the set.
        assert_eq!((found.in_set, found.set_size), (true, 3));
        assert_eq!(found.top, Some((0.5, false)));
        assert_eq!(found.said, "clearance+sensor-gain");
        // With another verdict, another explanation is the one that it states.
        assert_eq!(found.explanation, Some((0.5, false)));
        let of = |verdict: &str| judge(&clearance(), &[], &Claim { verdict: verdict.into(), ..said.clone() }, None);
        assert_eq!(["none", "unknown"].map(|is| of(is).explanation), [Some((0.04, false)), Some((0.1, false))]);
        // 1 - sqrt((0.03^2 - 0.02^2) / (0.1^2 - 0.02^2))
        assert!((found.shrink - (1.0 - (0.0005f64 / 0.0096).sqrt())).abs() < 1e-12 && found.shrinkable);
        assert_eq!(found.missed_by, Some(0.0));
    }

    #[test]
    fn wrong_places_and_wrong_names() {
        let at = |effect: &str, place: &str, sure: f64| {
            let named = json!([named(effect, place, sure)]);
            let said = json!({
                "verdict": "effects", "effects": named,
                "candidates": [{ "effects": named, "probability": 0.95 }, { "effects": [], "probability": 0.05 }],
            });
            judge(&clearance(), &[], &claim(said), None)
        };
        // The right name at a wrong place is exact, but not located, and it is not confidently wrong.
        let elsewhere = at("clearance", "input:u1", 0.95);
        assert!(elsewhere.exact && !elsewhere.located && !elsewhere.wrong && elsewhere.right);
        assert_eq!((elsewhere.in_set, elsewhere.set_size, elsewhere.top), (false, 1, Some((0.95, false))));
        let kin = at("coulomb-friction", "input:u2", 0.95);
        assert!(!kin.exact && kin.family && kin.wrong && kin.spurious);
        let unsure = at("sensor-gain", "output:y2", 0.89);
        assert!(!unsure.family && !unsure.wrong && !unsure.confident);
        // Nothing was predicted, so nothing shrinks.
        assert_eq!((unsure.shrink, unsure.missed_by), (0.0, None));
    }

    /// The clearance makes 8 % and an imperfection 1.5 %. Without the clearance in the answer, or with it at another
    /// place, a cause above 2 % is left. Above 1 %, the imperfection is one as well.
    #[test]
    fn a_further_cause_is_one_that_is_not_named() {
        let mut truth = clearance();
        truth.gap_background = Some(0.03);
        let small = crate::truth::TrueEffect { gap: 0.015, ..truth.effects[0].clone() };
        truth.background_effects = vec![crate::truth::TrueEffect { effect: "sensor-gain".to_owned(), loc: 0, ..small }];
        let of = |truth: &Truth, location: &str, material: Option<f64>| {
            let said = json!({
                "verdict": "effects", "effects": [named("clearance", location, 0.9)],
                "remainder": { "further_cause": 0.3, "material": material },
            });
            judge(truth, &[], &claim(said), None).further_cause
        };
        assert_eq!(of(&truth, "input:u2", Some(0.02)), Some((0.3, false)));
        assert_eq!(of(&truth, "input:u1", Some(0.02)), Some((0.3, true)));
        assert_eq!(of(&truth, "input:u2", Some(0.01)), Some((0.3, true)));
        // Effects count only if the verdict is "effects".
        let unknown = json!({ "verdict": "unknown", "remainder": { "further_cause": 0.8, "material": 0.02 } });
        assert_eq!(judge(&truth, &[], &claim(unknown), None).further_cause, Some((0.8, true)));
        // Without the size that counts as material, or without the imperfections, there is no telling.
        truth.background_effects.clear();
        assert_eq!((of(&clearance(), "input:u2", None), of(&truth, "input:u2", Some(0.02))), (None, None));
    }

    #[test]
    fn nothing_missing_and_no_answer() {
        let nothing = truth(json!([effect("none", 0)]));
        assert_eq!((asked(&nothing, &[]), wanted(&nothing).as_str()), (Asked::None, "none"));
        let none = claim(json!({
            "verdict": "none", "effects": [named("clearance", "input:u2", 0.99)],
            "candidates": [{ "effects": [], "probability": 0.97 }, { "effects": [], "unknown": true,
                "probability": 0.03 }],
        }));
        // Effects count only if the verdict is "effects".
        let found = judge(&nothing, &[], &none, Some(0.02));
        assert!(!found.named && found.right && !found.confident);
        assert_eq!(found.top, Some((0.97, true)));
        let alarm = claim(json!({ "verdict": "effects", "effects": [named("clearance", "input:u2", 0.95)] }));
        let found = judge(&nothing, &[], &alarm, None);
        assert!(found.named && found.wrong && !found.right && found.top.is_none());
        // Something else is at work only if there are imperfections.
        let open = claim(json!({
            "verdict": "unknown", "candidates": [{ "effects": [], "unknown": true, "probability": 0.8 }],
        }));
        let imperfect = Truth { gap_background: Some(0.03), ..nothing.clone() };
        assert_eq!(judge(&nothing, &[], &open, None).top, Some((0.8, false)));
        assert_eq!(judge(&imperfect, &[], &open, None).top, Some((0.8, true)));
        let missing = judge(&clearance(), &[], &Claim::missing(), None);
        assert_eq!(missing, Judged { said: "missing".to_owned(), shrinkable: true, ..Judged::default() });
    }

    #[test]
    fn outside_the_vocabulary_only_something_else_is_right() {
        let outsider = truth(json!([effect("x-command-play", 0)]));
        assert_eq!(asked(&outsider, &[]), Asked::Outside);
        let left_out = ["clearance".to_owned()];
        assert_eq!(asked(&clearance(), &left_out), Asked::Outside);
        assert_eq!(asked(&clearance(), &["sensor-gain".to_owned()]), Asked::Single);
        let with = |verdict: &str, unknown: f64, confidence: f64| {
            let near = json!([named("actuator-dead-zone", "input:u1", confidence)]);
            let said = json!({
                "verdict": verdict, "effects": near,
                "candidates": [
                    { "effects": near, "probability": 1.0 - unknown }, { "effects": [], "unknown": true,
                        "probability": unknown },
                ],
            });
            judge(&outsider, &[], &claim(said), None)
        };
        assert!(with("effects", 0.2, 0.8).open && !with("effects", 0.19, 0.81).open);
        assert!(with("effects", 0.05, 0.95).wrong && !with("effects", 0.2, 0.8).wrong);
        let unknown = with("unknown", 0.7, 0.3);
        assert!(unknown.open && !unknown.named);
        assert_eq!((unknown.top, with("effects", 0.2, 0.8).top), (Some((0.7, true)), Some((0.8, false))));
        // The name that was removed from the vocabulary would be wrong as well.
        let said = json!({ "verdict": "effects", "effects": [named("clearance", "input:u2", 0.95)] });
        assert!(judge(&clearance(), &left_out, &claim(said), None).wrong);
    }

    #[test]
    fn several_effects_are_all_named_or_not() {
        let pair = truth(json!([effect("clearance", 1), effect("sensor-gain", 0)]));
        assert_eq!((asked(&pair, &[]), wanted(&pair).as_str()), (Asked::Several, "clearance+sensor-gain"));
        let with = |effects: serde_json::Value| {
            let said = json!({
                "verdict": "effects", "effects": effects, "candidates": [{ "effects": effects, "probability": 1.0 }],
            });
            judge(&pair, &[], &claim(said), None)
        };
        let (one, other) = (named("clearance", "port:strut2", 0.95), named("sensor-gain", "output:y3", 0.95));
        let both = with(json!([other, one]));
        // Names are enough for "all named"; the explanation is right only with its places.
        assert!(both.all_named && both.right && !both.spurious);
        assert_eq!(both.top, Some((1.0, false)));
        assert!(!with(json!([one])).all_named);
        let more = with(json!([one, other, named("mains-hum", "output:y1", 0.5)]));
        assert!(!more.all_named && more.spurious && !more.wrong);
    }
}
