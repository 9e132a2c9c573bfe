//! The probabilities of effects other than the largest one in an imperfect simulation. Likelihoods do not say how often
//! such an effect is an error of the simulation that only resembles it; blind trials do.

use crate::answer::schema::{Explanation, Located};
use crate::settings::JudgeSettings;

/// Divides the probability of each explanation with several effects between it and its largest effect alone, which is
/// `main` if the explanation contains it.
pub(crate) fn divided(
    explanations: impl Iterator<Item = Explanation>,
    main: Option<&Located>,
    settings: &JudgeSettings,
) -> Vec<Explanation> {
    let divide = |explanation: Explanation| {
        let Some(further) = explanation.effects.len().checked_sub(1).filter(|&further| further > 0) else {
            return vec![explanation];
        };
        let all = settings.further_right.powi(further as i32);
        let largest = main.filter(|main| explanation.effects.contains(main)).unwrap_or(&explanation.effects[0]);
        let alone = Explanation {
            effects: vec![largest.clone()],
            unknown: false,
            probability: explanation.probability * (1.0 - all),
            gap_after: None,
            wiring: None,
        };
        vec![Explanation { probability: explanation.probability * all, ..explanation }, alone]
    };
    explanations.flat_map(divide).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(effect: &str) -> Located {
        Located { effect: effect.into(), location: "input:u1".into() }
    }

    fn explanation(effects: &[&str], probability: f64) -> Explanation {
        let effects = effects.iter().map(|effect| at(effect)).collect();
        Explanation { effects, unknown: false, probability, gap_after: None, wiring: None }
    }

    #[test]
    fn further_effects_share_their_probability_with_the_largest() {
        let settings = JudgeSettings { further_right: 0.8, ..JudgeSettings::default() };
        let all =
            [explanation(&["sensor-lag", "actuator-gain", "sensor-offset"], 0.9), explanation(&["sensor-lag"], 0.1)];
        let divided = divided(all.into_iter(), Some(&at("actuator-gain")), &settings);
        let sizes: Vec<usize> = divided.iter().map(|one| one.effects.len()).collect();
        assert_eq!(sizes, [3, 1, 1]);
        assert_eq!(divided[1].effects, [at("actuator-gain")]);
        let probabilities: Vec<f64> = divided.iter().map(|one| one.probability).collect();
        for (found, expected) in probabilities.iter().zip([0.9 * 0.64, 0.9 * 0.36, 0.1]) {
            assert!((found - expected).abs() < 1e-12, "{probabilities:?}");
        }
    }
}
