//! Statistics of the first explanation that might separate right causes from wrong ones. No probability depends on
//! them: `plid gap trial calibrate` finds out which of them separate best.
//!
//! Where a model is imperfect, the samples of its residual are not independent, so a log likelihood ratio overstates
//! the evidence. Three kinds of statistics do not depend on the number of samples: the share of the gap that is left;
//! the ratio with the number of samples replaced by that of effective ones (a tempered likelihood); and comparisons of
//! blocks of the record, whose mean difference over its standard error is Vuong's statistic (Econometrica 57, 1989,
//! 307).

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::fit::candidate::{all_same, same};
use crate::fit::problem::Placed;
use crate::judge::explained::Explained;
use crate::judge::gap::Blocks;
use crate::judge::judgement::Judgement;
use crate::judge::separability::Rival;
use crate::judge::shrink::{Gap, blocks, opened};

/// Largest ratio of two gaps that is recorded: where the noise explains the other gap, a larger one says no more.
const MOST_LEFT: f64 = 10.0;

/// The name of the first effect's probability before calibration.
pub const CONFIDENCE: &str = "confidence";

/// The statistics of the first explanation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Statistics {
    /// The first effect of the explanation. If the verdict is "unknown", the answer does not name it.
    pub effect: String,
    /// Its location.
    pub location: String,
    /// The statistics by name.
    pub values: BTreeMap<String, f64>,
}

/// Returns the statistics of the best explanation, whose first effect is `first`. Rivals are explanations without this
/// effect. `rivals` are those that were fitted to the prediction of the best explanation.
pub(crate) fn values(
    explained: &Explained,
    judged: &Judgement,
    rivals: &[Rival],
    first: &Placed,
) -> BTreeMap<String, f64> {
    let adequacy = &explained.judged;
    let mut all = left(&judged.gaps).to_vec();
    all.extend(likelihoods(explained, first));
    all.extend(by_blocks(explained, judged, rivals, first));
    all.extend([
        ("excess", adequacy.excess),
        ("left-of-excess", adequacy.left),
        ("beyond-limits", adequacy.max_prior_z),
        ("next-gain", adequacy.next_gain),
    ]);
    all.extend(judged.held_out.iter().flat_map(|held_out| {
        [("held-out-ratio", 0.5 * held_out.gain), ("held-out-z", held_out.gain / held_out.deviation)]
    }));
    all.into_iter().filter(|(_, value)| value.is_finite()).map(|(name, value)| (name.to_owned(), value)).collect()
}

/// Returns the remaining amplitude beyond the noise with the explanation, over that of the refit, of the simulation
/// within its limits and of the simulation as given; and that of the refit over that of the simulation as given.
fn left(gaps: &Gap) -> [(&'static str, f64); 4] {
    let over =
        |gap: f64, than: f64| (gaps.beyond_noise(gap) / gaps.beyond_noise(than).max(f64::MIN_POSITIVE)).min(MOST_LEFT);
    [
        ("left-of-refit", over(gaps.with_effect, gaps.refit)),
        ("left-of-limits", over(gaps.with_effect, gaps.within_limits)),
        ("left-of-given", over(gaps.with_effect, gaps.as_given)),
        ("left-by-refit", over(gaps.refit, gaps.as_given)),
    ]
}

/// Returns the log likelihood ratios of the explanation to the refit and to the best rival on the fitted records, both
/// untempered and tempered.
fn likelihoods(explained: &Explained, first: &Placed) -> [(&'static str, f64); 4] {
    let candidates = &explained.found.candidates;
    let own = candidates.iter().find(|one| all_same(&one.effects, &explained.found.best.effects));
    let own = own.map_or(explained.fit().cost, |own| own.cost);
    let none = explained.refitted.cost;
    let rival = candidates.iter().find(|one| !contains(&one.effects, first)).map_or(none, |rival| rival.cost);
    let samples = effective(&explained.fit().residual);
    let ratio = |other: f64| 0.5 * (other - own);
    let tempered = |other: f64| 0.5 * samples * (other / own).ln();
    [
        ("ratio-to-none", ratio(none)),
        ("ratio-to-rival", ratio(rival)),
        ("tempered-to-none", tempered(none)),
        ("tempered-to-rival", tempered(rival)),
    ]
}

/// Returns the comparisons with the simulation within its limits and with the nearest rival in blocks of the opened
/// records. A refit beyond the limits may imitate the effect itself.
fn by_blocks(explained: &Explained, judged: &Judgement, rivals: &[Rival], first: &Placed) -> Vec<(&'static str, f64)> {
    let (problem, opened) = (&explained.ready.problem, opened(explained));
    let within = explained.refitted.within_limits(problem);
    let none = blocks(&opened, &problem.nuisance.apply(&problem.plant, &within), &[]);
    let rival = rivals.iter().find(|rival| !contains(&rival.effects, first)).map(|rival| {
        let plant = problem.nuisance.apply(&problem.plant, &rival.fit.eta);
        blocks(&opened, &plant, &problem.actions(&rival.fit.effects))
    });
    // A rival that was fitted to other records may diverge in these.
    let rival = rival.filter(|blocks| blocks.gap().is_finite());
    let compared = |names: [&'static str; 2], other: &Blocks| {
        let gains = judged.simulated.gains_over(other);
        [(names[0], better(&gains)), (names[1], vuong(&gains))]
    };
    let mut all = compared(["blocks-over-none", "blocks-z-none"], &none).to_vec();
    all.extend(rival.iter().flat_map(|rival| compared(["blocks-over-rival", "blocks-z-rival"], rival)));
    all
}

fn contains(effects: &[Placed], first: &Placed) -> bool {
    effects.iter().any(|placed| same(placed, first))
}

/// Returns the number of independent samples with the same power in a residual whose power is concentrated: for normal
/// samples r, the mean of r⁴ is three times the squared mean of r².
fn effective(residual: &[f64]) -> f64 {
    let (two, four) = residual.iter().fold((0.0, 0.0), |(two, four), r| (two + r * r, four + r.powi(4)));
    if four > 0.0 { (3.0 * two * two / four).min(residual.len() as f64) } else { residual.len() as f64 }
}

/// Returns the share of gains above zero; a gain of zero counts half.
fn better(gains: &[f64]) -> f64 {
    let score = |gain: &f64| if *gain > 0.0 { 1.0 } else { f64::from(u8::from(*gain == 0.0)) / 2.0 };
    gains.iter().map(score).sum::<f64>() / gains.len() as f64
}

/// Returns the mean of gains over its standard error.
fn vuong(gains: &[f64]) -> f64 {
    let count = gains.len() as f64;
    let mean = gains.iter().sum::<f64>() / count;
    let variance = gains.iter().map(|gain| (gain - mean).powi(2)).sum::<f64>() / (count - 1.0);
    mean / (variance / count).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::judge::statement::About;
    use crate::testing;

    /// Samples of one power are all effective, because their fourth power is below that of normal ones. If one sample
    /// has all the power, three are.
    #[test]
    fn power_in_few_samples_is_little_evidence() {
        assert_eq!(effective(&[2.0; 50]), 50.0);
        let mut one = vec![0.0; 50];
        one[7] = 3.0;
        assert!((effective(&one) - 3.0).abs() < 1e-12);
        // The third power of a uniform variable in (-1, 1): E r² = 1/7 and E r⁴ = 1/13, so the share is 39 / 49.
        let cubes: Vec<f64> = (0..20_000).map(|k| (f64::from(k) / 1e4 - 1.0 + 5e-5).powi(3)).collect();
        assert!((effective(&cubes) / 20_000.0 - 39.0 / 49.0).abs() < 1e-3);
    }

    /// The gains 1, 2, 3 have the mean 2 and the standard deviation 1.
    #[test]
    fn blocks_by_hand() {
        assert!((vuong(&[1.0, 2.0, 3.0]) - 2.0 * 3_f64.sqrt()).abs() < 1e-12);
        assert_eq!(better(&[1.0, -2.0, 0.0, 3.0]), 2.5 / 4.0);
    }

    /// A sensor gain that is off is the first effect: with it, each block is simulated better. The answer records this
    /// and the statement about the remainder.
    #[test]
    fn an_answer_records_the_statistics_of_its_first_effect() {
        let sim = testing::truss(1);
        let mut case = testing::case(&sim, &sim);
        case.records.iter_mut().flat_map(|record| &mut record.y[0]).for_each(|y| *y *= 1.3);
        let diagnosis = testing::diagnosed_among(case, &["sensor-gain", "sensor-delay"]);
        let found = diagnosis.statistics.as_ref().unwrap();
        testing::first_is(&diagnosis, &found.effect, &found.location);
        assert_eq!(found.effect, "sensor-gain");
        assert!(found.values["left-of-limits"] < 0.5, "{found:?}");
        assert!(found.values["blocks-over-none"] > 0.9 && found.values["blocks-z-none"] > 2.0, "{found:?}");
        assert!(found.values["tempered-to-none"] > 0.0 && found.values["ratio-to-none"] > 0.0, "{found:?}");
        let (first, last) = (diagnosis.statements.first().unwrap(), diagnosis.statements.last().unwrap());
        assert_eq!((first.about, last.about), (About::Effect, About::Remainder));
        assert_eq!(last.before > 0.5, diagnosis.remainder.further_cause > 0.5);
        assert_eq!(diagnosis.remainder.material, 0.02);
    }
}
