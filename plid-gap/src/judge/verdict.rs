//! Probabilities of all explanations, including "something else", and the verdict.

use crate::fit::candidate::Candidate;
use crate::fit::candidate::all_same;
use crate::fit::problem::Placed;
use crate::prepare::NoiseLevel;
use crate::settings::step::Step;
use crate::settings::{GapSettings, JudgeSettings};

/// Temperature of the textbook's posterior probabilities, with which the ablation compares the diagnosis.
const TEXTBOOK: f64 = 2.0;

/// Exponent of the smooth thresholds on the share that an explanation leaves. The transition goes from 6 % to 94 %
/// between half the threshold and twice the threshold.
const STEEPNESS: i32 = 4;

/// The verdict of a diagnosis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Effects are named.
    Effects,
    /// The simulation is sound within its limits.
    None,
    /// Something outside the vocabulary is at work.
    Unknown,
}

/// An explanation with its probability.
pub struct Weighted<'a> {
    /// Its effects; empty for no effect, or for something else.
    pub effects: Vec<Placed<'a>>,
    /// Whether it is something outside the vocabulary.
    pub unknown: bool,
    /// Its probability; all probabilities add up to one.
    pub probability: f64,
    /// Mean squared whitened residual, if the explanation was fitted.
    pub cost: Option<f64>,
}

/// The residual of the best explanation compared with the noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Adequacy {
    /// Excess over the noise, (mean square / noise level - 1) / uncertainty of the noise level.
    pub excess: f64,
    /// Remaining share of the bounded refit's excess.
    pub left: f64,
    /// The largest change of a linear parameter, in standard deviations of the stated limits.
    pub max_prior_z: f64,
    /// Gain of the best further entry of the screen.
    pub next_gain: f64,
    /// Probability of something else.
    pub unknown: f64,
}

/// The figures by which an explanation is judged.
#[derive(Debug, Clone, Copy)]
pub struct FitFigures {
    /// The largest change of a linear parameter, in standard deviations of its prior.
    pub max_prior_z: f64,
    /// Gain of the best further entry of the screen.
    pub next_gain: f64,
    /// Sum of squares with the explanation.
    pub cost: f64,
    /// Sum of squares without effects.
    pub before: f64,
    /// Number of whitened values.
    pub rows: f64,
    /// The noise level.
    pub level: NoiseLevel,
}

/// Judges the residual of an explanation.
pub fn adequacy(figures: &FitFigures, settings: &JudgeSettings, off: &[Step]) -> Adequacy {
    let &FitFigures { max_prior_z, next_gain, cost, before, rows, level } = figures;
    let noise = rows * level.factor;
    let excess = (cost / noise - 1.0) / level.uncertainty;
    let left = ((cost - noise) / (before - noise).max(1.0)).clamp(0.0, 1.0);
    let certain = 1.0 / (1.0 + (-(excess - settings.excess)).exp());
    // A remainder of a thousandth of a large gap concerns the third digit of the effect's parameters, not another
    // cause.
    let material = 1.0 / (1.0 + (settings.material_left / left.max(1e-12)).powi(STEEPNESS));
    // Beyond its stated limits, a refit may hide an effect that the vocabulary lacks.
    let beyond = 1.0 / (1.0 + (-(max_prior_z - settings.max_prior_z) / settings.prior_z_width).exp());
    // A residual that still correlates with an effect's trace is not noise, even if no effect explains it.
    let coherent = 1.0 / (1.0 + (-(next_gain - settings.next_gain) / settings.next_gain_width).exp());
    let speaks = |step: Step, share: f64| if off.contains(&step) { 0.0 } else { share };
    let sound = (1.0 - speaks(Step::Excess, certain * material))
        * (1.0 - speaks(Step::BeyondLimits, beyond))
        * (1.0 - speaks(Step::Coherent, coherent));
    let JudgeSettings { least_unknown, most_unknown, .. } = *settings;
    let unknown = least_unknown + (most_unknown - least_unknown) * (1.0 - sound);
    Adequacy { excess, left, max_prior_z, next_gain, unknown }
}

/// Returns the probability of something else if an explanation leaves this share, in amplitude, of the gap beyond
/// noise and limits. This probability applies if the simulation is off in so many small ways that no explanation
/// leaves only noise.
pub fn outside(left: f64, settings: &JudgeSettings) -> f64 {
    let JudgeSettings { least_unknown, most_unknown, most_left, .. } = *settings;
    if left > most_left {
        return most_unknown;
    }
    least_unknown + (most_unknown - least_unknown) / (1.0 + (most_left / left.max(1e-6)).powi(STEEPNESS))
}

/// Distributes probability over the candidates; "something else" receives `unknown`.
pub fn weigh<'a>(
    candidates: &[Candidate<'a>],
    unknown: f64,
    rows: f64,
    level: NoiseLevel,
    settings: &GapSettings,
    off: &[Step],
) -> Vec<Weighted<'a>> {
    let JudgeSettings { temperature: least, misfit_temperature, least_probability, .. } = settings.judge;
    let Some(best) = candidates.first() else { return Vec::new() };
    let misfit = (best.cost - rows * level.factor * (1.0 + 2.0 * level.uncertainty)).max(0.0);
    let temperature = if off.contains(&Step::Temperature) { TEXTBOOK } else { least + misfit_temperature * misfit };
    // Explanations that the search did not accept rank behind the one without effects. A misfit that none of them
    // explains makes none of them more probable.
    let unaccepted = |candidate: &Candidate| best.effects.is_empty() && !candidate.effects.is_empty();
    let most = if off.contains(&Step::Temperature) { 1.0 } else { (-settings.search.not_accepted_price / least).exp() };
    let mut weighted: Vec<Weighted> = Vec::new();
    for candidate in candidates {
        let weight = (-(candidate.priced - best.priced) / temperature).exp();
        let weight = if unaccepted(candidate) { weight.min(most) } else { weight };
        if weighted.iter().any(|other| all_same(&candidate.effects, &other.effects)) {
            continue;
        }
        weighted.push(Weighted {
            effects: candidate.effects.clone(),
            unknown: false,
            probability: weight,
            cost: Some(candidate.cost / rows),
        });
    }
    let all: f64 = weighted.iter().map(|w| w.probability).sum();
    weighted.iter_mut().for_each(|w| w.probability *= (1.0 - unknown) / all);
    weighted.push(Weighted { effects: Vec::new(), unknown: true, probability: unknown, cost: None });
    weighted.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    // Negligible probabilities are left out, and their share goes to the others.
    weighted.retain(|w| w.probability > least_probability);
    let all: f64 = weighted.iter().map(|w| w.probability).sum();
    weighted.iter_mut().for_each(|w| w.probability /= all);
    weighted
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{Library, Place};

    const ROWS: f64 = 1e4;

    fn level() -> NoiseLevel {
        NoiseLevel { factor: 1.0, uncertainty: 0.02, seen: true, driven: None }
    }

    /// The more an explanation leaves, the less probable it is; one that leaves more than half is never the verdict.
    #[test]
    fn what_leaves_half_of_the_gap_is_outside() {
        let left = [0.0, 0.03, 0.1, 0.36, 0.49];
        let settings = JudgeSettings::default();
        let unknown = left.map(|left| outside(left, &settings));
        assert!(unknown.windows(2).all(|pair| pair[0] < pair[1]), "{unknown:?}");
        assert!(unknown[3] < 0.25 && unknown[4] < 0.5, "{unknown:?}");
        // It exceeds the sum of all other probabilities.
        assert!(outside(0.51, &settings) > 0.5 && outside(2.0, &settings) > 0.5);
    }

    /// Explanations that the search did not accept rank behind the one without effects by their price, whatever the
    /// misfit.
    #[test]
    fn what_was_not_accepted_stays_behind_nothing() {
        let settings = GapSettings::default();
        let library = Library::standard();
        let placed = |name: &str| {
            let effect = library.get(name).unwrap();
            Placed { effect, place: Place::Output(0), parameters: vec![1.0] }
        };
        for left in [1.0, 2.0] {
            let cost = left * ROWS;
            let nothing = Candidate { effects: Vec::new(), cost, priced: cost };
            let tried = ["sensor-gain", "sensor-offset", "sensor-delay", "sensor-lag"].map(|name| Candidate {
                effects: vec![placed(name)],
                cost: cost - 5.0,
                priced: cost + settings.search.not_accepted_price,
            });
            let candidates: Vec<Candidate> = std::iter::once(nothing).chain(tried).collect();
            let weighted = weigh(&candidates, 0.3, ROWS, level(), &settings, &[]);
            let sum: f64 = weighted.iter().map(|w| w.probability).sum();
            assert!((sum - 1.0).abs() < 1e-12, "{sum}");
            assert!(weighted[0].effects.is_empty() && !weighted[0].unknown && weighted[0].probability > 0.5, "{left}");
            // The textbook's probabilities ignore the misfit, so these explanations rank even further behind.
            let flat = weigh(&candidates, 0.3, ROWS, level(), &settings, &[Step::Temperature]);
            assert!(flat[0].probability > weighted[0].probability);
        }
    }
}
