//! Corrections of the probability of something else by the verdict, and by how often such answers of blind trials were
//! right. Likelihoods say how much better one explanation is than another, and not how often none of them is right.

use crate::judge::verdict::Weighted;
use crate::settings::JudgeSettings;

/// Gives something else the probability with which such a verdict is right. The first explanation is something else.
pub(crate) fn of_unknown(weighted: &mut [Weighted], settings: &JudgeSettings) {
    let Some((unknown, others)) = weighted.split_first_mut() else { return };
    if unknown.probability >= settings.unknown_right {
        return;
    }
    let factor = (1.0 - settings.unknown_right) / (1.0 - unknown.probability);
    unknown.probability = settings.unknown_right;
    others.iter_mut().for_each(|other| other.probability *= factor);
}

/// Gives "nothing is missing" the probability of something else, except the least one, where that makes no material
/// gap.
pub(crate) fn of_immaterial(weighted: &mut Vec<Weighted>, settings: &JudgeSettings) {
    let Some(unknown) = weighted.iter_mut().find(|explanation| explanation.unknown) else { return };
    let moved = (unknown.probability - settings.least_unknown).max(0.0);
    unknown.probability -= moved;
    match weighted.iter_mut().find(|explanation| !explanation.unknown && explanation.effects.is_empty()) {
        Some(nothing) => nothing.probability += moved,
        None => weighted.push(Weighted { effects: Vec::new(), unknown: false, probability: moved, cost: None }),
    }
    weighted.sort_by(|a, b| b.probability.total_cmp(&a.probability));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unknown_gap_has_the_probability_of_such_answers() {
        let settings = JudgeSettings::default();
        let weighted = |probability: f64, unknown: bool| Weighted { effects: vec![], unknown, probability, cost: None };
        let mut all = [weighted(0.6, true), weighted(0.3, false), weighted(0.1, false)];
        of_unknown(&mut all, &settings);
        assert!((all[0].probability - settings.unknown_right).abs() < 1e-12);
        assert!((all[1].probability / all[2].probability - 3.0).abs() < 1e-12);
        assert!((all.iter().map(|one| one.probability).sum::<f64>() - 1.0).abs() < 1e-12);
        // What is more probable stays so.
        let mut sure = [weighted(0.98, true), weighted(0.02, false)];
        of_unknown(&mut sure, &settings);
        assert!((sure[0].probability - 0.98).abs() < 1e-12);
    }

    #[test]
    fn an_immaterial_gap_is_nothing() {
        let settings = JudgeSettings::default();
        let weighted = |probability: f64, unknown: bool| Weighted { effects: vec![], unknown, probability, cost: None };
        for mut all in [vec![weighted(0.6, true), weighted(0.4, false)], vec![weighted(1.0, true)]] {
            of_immaterial(&mut all, &settings);
            assert!(!all[0].unknown && (all[0].probability - 1.0 + settings.least_unknown).abs() < 1e-12);
            assert!((all.iter().map(|one| one.probability).sum::<f64>() - 1.0).abs() < 1e-12);
        }
    }
}
