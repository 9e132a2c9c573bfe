//! Explanations and effects with calibrated probabilities.

use crate::answer::schema::{Explanation, Located, NamedEffect};
use crate::judge::calibration::Calibration;
use crate::judge::statement::{About, Statement};

/// Assigns calibrated probabilities to the first explanation and, if effects are the verdict, to the named effects.
/// The other explanations share the rest in proportion. An effect may act together with something else, so its
/// probability may exceed that of all explanations that contain it.
pub(crate) fn calibrated(
    explanations: Vec<Explanation>,
    named: &mut [NamedEffect],
    statements: &[Statement],
    calibration: &Calibration,
) -> Vec<Explanation> {
    let Some(first) = statements.first() else { return explanations };
    let mut all = explanations;
    match (first.about, named.split_first_mut()) {
        (About::Nothing, _) => {
            let nothing = |one: &Explanation| !one.unknown && one.effects.is_empty();
            let probability = calibration.probability(first);
            rescale(&mut all, &nothing, [probability; 2]);
            keep_ahead(&mut all, &nothing);
        }
        (About::Unknown, _) => rescale(&mut all, &|one| one.unknown, [calibration.probability(first); 2]),
        (_, None) => {}
        (_, Some((main, further))) => {
            let main_at = located(main);
            let acts = calibration.probability(first);
            let shares: Vec<(Located, f64)> = further
                .iter()
                .zip(&statements[1..])
                .map(|(effect, statement)| (located(effect), (calibration.probability(statement) / acts).min(1.0)))
                .collect();
            all = all.into_iter().flat_map(|one| divided(one, &main_at, &shares)).collect();
            let has_main = |one: &&Explanation| one.effects.contains(&main_at);
            let largest = all.iter().filter(has_main).max_by(|a, b| a.probability.total_cmp(&b.probability));
            let Some(leading) = largest.map(|one| one.effects.clone()) else { return all };
            let whole = calibration.of(About::Explanation).probability(first).min(acts);
            let leads = |one: &Explanation| one.effects == leading;
            rescale(&mut all, &leads, [whole, acts]);
            keep_ahead(&mut all, &leads);
            weigh(main, acts);
            for (effect, (_, share)) in further.iter_mut().zip(&shares) {
                weigh(effect, share * acts);
            }
        }
    }
    all.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    all
}

/// Assigns this probability to an effect. The other members of its family belong to the other explanations and keep
/// their share of the rest.
fn weigh(effect: &mut NamedEffect, probability: f64) {
    if let Some(family) = &mut effect.family {
        let others = (family.confidence - effect.confidence).max(0.0) / (1.0 - effect.confidence).max(1e-9);
        family.confidence = (probability + others * (1.0 - probability)).min(1.0);
    }
    effect.confidence = probability;
}

fn located(effect: &NamedEffect) -> Located {
    Located { effect: effect.effect.clone(), location: effect.location.clone() }
}

/// Divides the probability of an explanation with further effects between this explanation and the one without these
/// effects. The division follows the probability of each further effect if the main effect acts.
fn divided(one: Explanation, main: &Located, further: &[(Located, f64)]) -> Vec<Explanation> {
    if !one.effects.contains(main) {
        return vec![one];
    }
    let (beside, rest): (Vec<&Located>, Vec<&Located>) =
        one.effects.iter().partition(|effect| further.iter().any(|(other, _)| other == *effect));
    let share: f64 = further.iter().filter(|(other, _)| beside.contains(&other)).map(|(_, share)| share).product();
    if share >= 1.0 {
        return vec![one];
    }
    let alone = Explanation {
        effects: rest.into_iter().cloned().collect(),
        probability: one.probability * (1.0 - share),
        gap_after: None,
        ..one.clone()
    };
    vec![Explanation { probability: one.probability * share, ..one }, alone]
}

/// Rescales the explanations of the kind `are` to a probability in total, and the others to the rest.
///
/// Calibration says of two statements how often they are right: that the named effect acts (`most`), and that the first
/// explanation is complete (`least`). Between the two, the effect acts together with something that no explanation
/// contains. If this share went to the others, they could come before the first explanation, although most of them deny
/// the effect. The first explanation therefore gets as much of it as it needs to stay the first one. If even `most` is
/// too little, another one comes first, because no statement is raised above its calibration.
fn rescale(all: &mut Vec<Explanation>, are: &dyn Fn(&Explanation) -> bool, [least, most]: [f64; 2]) {
    let (mut own, mut largest_own, mut rest, mut largest_rest) = (0.0, 0.0_f64, 0.0, 0.0_f64);
    for one in all.iter() {
        let (sum, largest) = if are(one) { (&mut own, &mut largest_own) } else { (&mut rest, &mut largest_rest) };
        *sum += one.probability;
        *largest = largest.max(one.probability);
    }
    if own <= 0.0 {
        return;
    }
    if rest <= 0.0 {
        all.push(something_else(1.0));
        (rest, largest_rest) = (1.0, 1.0);
    }
    let (of_own, of_rest) = (largest_own / own, largest_rest / rest);
    let probability = least.max(most.min(of_rest / (of_own + of_rest)));
    for one in all.iter_mut() {
        one.probability *= if are(one) { probability / own } else { (1.0 - probability) / rest };
    }
}

/// Keeps the explanations of the kind `are` ahead of the others of the vocabulary, as likelihoods rank them. If the
/// first explanation is right less often than its likelihood claims, another one is not necessarily right instead. The
/// probability by which another one would exceed the first is therefore given to something else.
fn keep_ahead(all: &mut Vec<Explanation>, are: &dyn Fn(&Explanation) -> bool) {
    let first = all.iter().filter(|one| are(one)).map(|one| one.probability).fold(0.0, f64::max);
    if first <= 0.0 {
        return;
    }
    let mut excess = 0.0;
    for one in all.iter_mut().filter(|one| !are(one) && !one.unknown) {
        excess += (one.probability - first).max(0.0);
        one.probability = one.probability.min(first);
    }
    match all.iter_mut().find(|one| one.unknown) {
        Some(other) => other.probability += excess,
        None if excess > 0.0 => all.push(something_else(excess)),
        None => {}
    }
}

fn something_else(probability: f64) -> Explanation {
    Explanation { effects: Vec::new(), unknown: true, probability, gap_after: None, wiring: None }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::judge::calibration::Coefficients;

    fn at(effect: &str) -> Located {
        Located { effect: effect.into(), location: "input:u1".into() }
    }

    fn explanation(effects: &[&str], unknown: bool, probability: f64) -> Explanation {
        let effects = effects.iter().map(|effect| at(effect)).collect();
        Explanation { effects, unknown, probability, gap_after: None, wiring: None }
    }

    fn named(effect: &str, confidence: f64) -> NamedEffect {
        NamedEffect {
            effect: effect.into(),
            location: "input:u1".into(),
            confidence,
            family: None,
            share: None,
            share_ci95: None,
            parameters: BTreeMap::new(),
            change: None,
            shape_differs: false,
        }
    }

    /// Returns coefficients with which a statement has this probability, whatever its basis.
    fn always(probability: f64) -> Coefficients {
        let constant = crate::judge::calibration::log_odds(probability);
        Coefficients { constant, before: 0.0, basis: BTreeMap::new() }
    }

    fn statement(about: About, before: f64) -> Statement {
        Statement { about, before, basis: BTreeMap::new() }
    }

    #[test]
    fn effects_have_the_probabilities_of_their_statements() {
        let explanations = vec![
            explanation(&["sensor-lag", "actuator-gain"], false, 0.9),
            explanation(&["sensor-delay"], false, 0.06),
            explanation(&[], true, 0.04),
        ];
        let mut effects = [named("sensor-lag", 0.9), named("actuator-gain", 0.9)];
        let statements = [statement(About::Effect, 0.9), statement(About::Further, 0.9)];
        let (effect, further, explanation) = (always(0.8), always(0.6), always(0.55));
        let calibration = Calibration { effect, further, explanation, ..Calibration::default() };
        let all = calibrated(explanations, &mut effects, &statements, &calibration);
        let confidences = effects.map(|effect| effect.confidence);
        assert!((confidences[0] - 0.8).abs() < 1e-12 && (confidences[1] - 0.6).abs() < 1e-12, "{confidences:?}");
        // A quarter of the explanation by both effects goes to the main effect alone. All but the first explanation
        // are scaled to 0.45 in total.
        let rest = 0.45 / (0.225 + 0.06 + 0.04);
        let wanted = [(2, 0.55), (1, 0.225 * rest), (1, 0.06 * rest), (0, 0.04 * rest)];
        for (one, (effects, probability)) in all.iter().zip(wanted) {
            assert!(one.effects.len() == effects && (one.probability - probability).abs() < 1e-12, "{one:?}");
        }
    }

    /// Returns the confidence of a lag, and the explanations by it, by a delay and by something else. Calibration
    /// assigns these probabilities to the lag and to the explanation by it.
    fn of_lag(before: [f64; 3], [acts, complete]: [f64; 2]) -> (f64, Vec<(String, f64)>) {
        let explanations = vec![
            explanation(&["sensor-lag"], false, before[0]),
            explanation(&["sensor-delay"], false, before[1]),
            explanation(&[], true, before[2]),
        ];
        let mut effects = [named("sensor-lag", before[0])];
        let calibration = Calibration { effect: always(acts), explanation: always(complete), ..Calibration::default() };
        let statements = [statement(About::Effect, before[0])];
        let name = |one: &Explanation| one.effects.first().map_or("something else", |at| at.effect.as_str()).to_owned();
        let all = calibrated(explanations, &mut effects, &statements, &calibration);
        (effects[0].confidence, all.iter().map(|one| (name(one), one.probability)).collect())
    }

    fn check(before: [f64; 3], calibrated: [f64; 2], expected: [(&str, f64); 3]) {
        let (confidence, all) = of_lag(before, calibrated);
        assert!((confidence - calibrated[0]).abs() < 1e-12, "{confidence}");
        assert_eq!(all.len(), 3);
        for (name, probability) in expected {
            let found = all.iter().find(|(other, _)| other == name).unwrap();
            assert!((found.1 - probability).abs() < 1e-12, "{all:?}");
        }
        assert!(all.windows(2).all(|pair| pair[0].1 >= pair[1].1), "{all:?}");
    }

    /// The effect is less probable than something else, and the answer says so.
    #[test]
    fn no_effect_is_raised_above_its_calibration() {
        check([0.7, 0.0, 0.3], [0.1, 0.1], [("sensor-lag", 0.1), ("sensor-delay", 0.0), ("something else", 0.9)]);
        check([0.7, 0.0, 0.3], [0.4, 0.2], [("sensor-lag", 0.4), ("sensor-delay", 0.0), ("something else", 0.6)]);
    }

    /// The effect acts more probably than not, but seldom alone: something else, which would deny it, does not lead.
    #[test]
    fn an_explanation_that_is_seldom_complete_still_leads() {
        check([0.7, 0.0, 0.3], [0.6, 0.3], [("sensor-lag", 0.5), ("sensor-delay", 0.0), ("something else", 0.5)]);
    }

    /// Two explanations that the records hardly distinguish keep their order, and something else gets the rest.
    #[test]
    fn a_rival_does_not_gain_from_doubts_in_the_first() {
        check([0.51, 0.49, 0.0], [0.4, 0.4], [("sensor-lag", 0.4), ("sensor-delay", 0.4), ("something else", 0.2)]);
        let (_, all) = of_lag([0.51, 0.49, 0.0], [0.4, 0.4]);
        assert_eq!(all[0].0, "sensor-lag");
    }

    /// If the answer is that nothing is missing, its probability is the calibrated one, too.
    #[test]
    fn nothing_is_not_raised_above_its_calibration() {
        let calibration = Calibration { nothing: always(0.2), ..Calibration::default() };
        let explanations = vec![explanation(&[], false, 0.6), explanation(&["sensor-lag"], false, 0.4)];
        let all = calibrated(explanations, &mut [], &[statement(About::Nothing, 0.6)], &calibration);
        let found: Vec<(bool, f64)> = all.iter().map(|one| (one.unknown, one.probability)).collect();
        assert!(found[0].0 && (found[0].1 - 0.6).abs() < 1e-12, "{found:?}");
        assert!(found[1..].iter().all(|(unknown, p)| !unknown && (p - 0.2).abs() < 1e-12), "{found:?}");
    }

    #[test]
    fn something_else_takes_what_no_explanation_has() {
        let calibration = Calibration { nothing: always(0.9), unknown: always(0.8), ..Calibration::default() };
        let sure = vec![explanation(&[], false, 1.0)];
        let all = calibrated(sure, &mut [], &[statement(About::Nothing, 1.0)], &calibration);
        assert!((all[0].probability - 0.9).abs() < 1e-12 && all[1].unknown && (all[1].probability - 0.1).abs() < 1e-12);
        let open = vec![explanation(&[], true, 0.6), explanation(&["sensor-lag"], false, 0.4)];
        let all = calibrated(open, &mut [], &[statement(About::Unknown, 0.6)], &calibration);
        assert!((all[0].probability - 0.8).abs() < 1e-12 && (all[1].probability - 0.2).abs() < 1e-12);
    }
}
