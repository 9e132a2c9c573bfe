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
            rescale(&mut all, &|one| !one.unknown && one.effects.is_empty(), calibration.probability(first));
        }
        (About::Unknown, _) => {
            rescale(&mut all, &|one| one.unknown, calibration.probability(first));
        }
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
            let reached = rescale(&mut all, &|one| one.effects == leading, whole);
            weigh(main, acts.max(reached));
            for (effect, (_, share)) in further.iter_mut().zip(&shares) {
                weigh(effect, share * acts);
            }
        }
    }
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

/// Rescales the explanations of the kind `are` to this probability in total, and the others to the rest. An answer
/// names its first explanation, which must stay the most probable one, so the probability may be raised. Returns the
/// total probability of the kind.
fn rescale(all: &mut Vec<Explanation>, are: &dyn Fn(&Explanation) -> bool, probability: f64) -> f64 {
    let (mut own, mut largest_own, mut rest, mut largest_rest) = (0.0, 0.0_f64, 0.0, 0.0_f64);
    for one in all.iter() {
        let (sum, largest) = if are(one) { (&mut own, &mut largest_own) } else { (&mut rest, &mut largest_rest) };
        *sum += one.probability;
        *largest = largest.max(one.probability);
    }
    if own <= 0.0 {
        return probability;
    }
    if rest <= 0.0 {
        all.push(something_else());
        (rest, largest_rest) = (1.0, 1.0);
    }
    let (of_own, of_rest) = (largest_own / own, largest_rest / rest);
    let probability = probability.max(of_rest / (of_own + of_rest));
    for one in all.iter_mut() {
        one.probability *= if are(one) { probability / own } else { (1.0 - probability) / rest };
    }
    all.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    probability
}

fn something_else() -> Explanation {
    Explanation { effects: Vec::new(), unknown: true, probability: 1.0, gap_after: None, wiring: None }
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

    /// The calibrated probability may be low, but an answer still names its first explanation.
    #[test]
    fn the_first_explanation_stays_the_first() {
        let explanations = vec![explanation(&["sensor-lag"], false, 0.7), explanation(&[], true, 0.3)];
        let mut effects = [named("sensor-lag", 0.7)];
        let calibration = Calibration { effect: always(0.1), explanation: always(0.1), ..Calibration::default() };
        let all = calibrated(explanations, &mut effects, &[statement(About::Effect, 0.7)], &calibration);
        assert!((effects[0].confidence - 0.5).abs() < 1e-12);
        assert!(!all[0].unknown && (all[0].probability - 0.5).abs() < 1e-12);
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
