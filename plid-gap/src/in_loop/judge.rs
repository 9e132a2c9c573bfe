//! The comparison of explanations, and the probability of each.

use crate::case::record::{Channels, rms};
use crate::effects::Place;
use crate::fit::candidate::{all_same, same};
use crate::fit::problem::Placed;
use crate::in_loop::problem::{Fit, Problem};
use crate::in_loop::search::{Found, Search};
use crate::judge::calibration::Calibration;
use crate::judge::statement::{AT_LIMIT, are_at_limit};
use crate::judge::verdict::{Verdict, Weighted, outside};
use crate::settings::JudgeSettings;

/// The evidence of the records for one explanation against another.
pub(super) struct Evidence {
    /// Difference of the sums of squares.
    pub difference: f64,
    /// The difference over its standard deviation, which is estimated from parts of the records.
    pub z: f64,
}

/// Number of groups of frequencies, and of stretches of each record. It is prime, so that the lines of a periodic
/// input are spread over all groups.
const GROUPS: usize = 23;

/// Compares two explanations. No explanation of real records is exact, so both residuals exceed the noise, and the
/// difference of their sums of squares scatters more than that of two log likelihoods. The scatter is therefore
/// estimated from parts of the records (Vuong, Econometrica 57, 1989). Each value r contributes ln(1 + r^2), as in a
/// likelihood with heavy tails. Otherwise the few values with most of the power would decide alone.
///
/// The parts are groups of frequencies, each spread over the whole band like the teeth of a comb, or stretches of
/// time, whichever separate the explanations more clearly. An offset affects a single frequency but all times, and a
/// delay affects all frequencies.
pub(super) fn evidence(problem: &Problem, better: &Fit, worse: &Fit) -> Evidence {
    let z = over_frequencies(problem, better, worse).max(over_time(problem, better, worse));
    Evidence { difference: worse.cost - better.cost, z }
}

fn over_frequencies(problem: &Problem, better: &Fit, worse: &Fit) -> f64 {
    let rows = problem.rows();
    // Real and imaginary parts of all outputs at one frequency.
    let together = 2 * problem.setting.plant.p;
    let mut each = vec![0.0; GROUPS];
    for (row, (worse, better)) in worse.residual[..rows].iter().zip(&better.residual).enumerate() {
        each[row / together % GROUPS] += heavy(*worse) - heavy(*better);
    }
    clear(&each)
}

fn over_time(problem: &Problem, better: &Fit, worse: &Fit) -> f64 {
    let errors = |fit: &Fit| -> Vec<Channels> {
        problem.records.iter().zip(&fit.simulated).map(|(record, y)| record.error(y)).collect()
    };
    let measured = |o: usize| {
        problem.records.iter().zip(&better.simulated).flat_map(move |(record, y)| record.measured_error(o, &y[o]))
    };
    let scale = |o: usize| rms(measured(o)).max(f64::MIN_POSITIVE);
    let scales: Vec<f64> = (0..problem.setting.plant.p).map(scale).collect();
    // A missing sample speaks for neither.
    let (better, worse) = (errors(better), errors(worse));
    let mut each = Vec::new();
    for (better, worse) in better.iter().zip(&worse) {
        let samples = better[0].len();
        for stretch in 0..GROUPS.min(samples) {
            let (from, to) = (stretch * samples / GROUPS, (stretch + 1) * samples / GROUPS);
            let of = |error: &Channels| -> f64 {
                error.iter().zip(&scales).flat_map(|(e, scale)| e[from..to].iter().map(move |e| heavy(e / scale))).sum()
            };
            each.push(of(worse) - of(better));
        }
    }
    clear(&each)
}

fn heavy(r: f64) -> f64 {
    (1.0 + r * r).ln()
}

/// Returns the sum of independent parts over its standard deviation.
fn clear(each: &[f64]) -> f64 {
    let count = each.len() as f64;
    let mean = each.iter().sum::<f64>() / count;
    let scatter: f64 = each.iter().map(|x| (x - mean).powi(2)).sum();
    let std = (scatter * count / (count - 1.0)).sqrt();
    if std > 0.0 { count * mean / std } else { 0.0 }
}

/// The judgement of a search.
pub(super) struct Judged<'a> {
    /// All explanations, the most probable first.
    pub weighted: Vec<Weighted<'a>>,
    /// The verdict.
    pub verdict: Verdict,
    /// Explanations that these records cannot separate from the best one.
    pub not_separable: Vec<Vec<Placed<'a>>>,
}

impl Judged<'_> {
    /// Refuses the best explanation because other records refute it: something else is at work, with at least this
    /// probability.
    pub fn refuse(&mut self, least: f64) {
        let probability = |unknown: bool| -> f64 {
            self.weighted.iter().filter(|w| w.unknown == unknown).map(|w| w.probability).sum()
        };
        let (known, before) = (probability(false), probability(true));
        let unknown = before.max(least);
        self.weighted.retain(|w| !w.unknown);
        self.weighted.iter_mut().for_each(|w| w.probability *= (1.0 - unknown) / known);
        self.weighted.push(Weighted { effects: Vec::new(), unknown: true, probability: unknown, cost: None });
        self.weighted.sort_by(|a, b| b.probability.total_cmp(&a.probability));
        self.verdict = Verdict::Unknown;
    }
}

/// Judges the explanations of a search.
pub(super) fn judge<'a>(
    search: &Search<'_, 'a>,
    problem: &Problem<'a>,
    found: &Found<'a>,
    settings: &JudgeSettings,
) -> Judged<'a> {
    let best = &found.fits[0];
    let within = search.left(problem, &found.refit);
    // A simulator whose error exceeds the output explains less than an output of zero does, so its error is no scale
    // for the remainder.
    let whole = within.min(1.0);
    let left = if whole > 0.0 { (search.left(problem, best) / whole).min(1.0) } else { 0.0 };
    let named = !best.effects.is_empty();
    let unknown = match (named, within > search.material) {
        (true, _) => outside(left, settings),
        (false, true) => settings.most_unknown,
        (false, false) => settings.least_unknown,
    };
    let unknown = if are_at_limit(&best.effects) {
        1.0 - Calibration::used().effect.shifted(1.0 - unknown, AT_LIMIT)
    } else {
        unknown
    };
    let mut weighted: Vec<Weighted> = Vec::new();
    let mut not_separable = Vec::new();
    for (at, fit) in found.fits.iter().enumerate() {
        if weighted.iter().any(|other| all_same(&other.effects, &fit.effects)) {
            continue;
        }
        let Evidence { difference, z } = evidence(problem, best, fit);
        let price = search.price(problem, fit) - search.price(problem, best);
        // An explanation that was not accepted ranks behind the best one, regardless of its cost.
        let behind = if at == 0 { 0.0 } else { (difference + price).min(z.max(0.0).powi(2)).max(0.0) };
        let probability = (-0.5 * behind).exp();
        if at > 0 && z < search.settings.clear && !fit.effects.is_empty() && named && is_rival(best, fit) {
            not_separable.push(fit.effects.clone());
        }
        let cost = Some(fit.cost / problem.values());
        weighted.push(Weighted { effects: fit.effects.clone(), unknown: false, probability, cost });
    }
    let all: f64 = weighted.iter().map(|w| w.probability).sum();
    weighted.iter_mut().for_each(|w| w.probability *= (1.0 - unknown) / all);
    weighted.push(Weighted { effects: Vec::new(), unknown: true, probability: unknown, cost: None });
    weighted.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    weighted.retain(|w| w.probability > settings.least_probability);
    let all: f64 = weighted.iter().map(|w| w.probability).sum();
    weighted.iter_mut().for_each(|w| w.probability /= all);
    let of = |which: &dyn Fn(&Weighted) -> bool| -> f64 {
        weighted.iter().filter(|w| which(w)).map(|w| w.probability).sum()
    };
    let effects = of(&|w| !w.effects.is_empty());
    let verdict = if !named && within <= search.material {
        Verdict::None
    } else if named && effects > unknown {
        Verdict::Effects
    } else {
        Verdict::Unknown
    };
    Judged { weighted, verdict, not_separable }
}

/// Returns whether an explanation has no more effects than the best one, but a different effect or location among
/// them. An explanation with one more effect contains the best one and is not its rival.
fn is_rival(best: &Fit, fit: &Fit) -> bool {
    fit.effects.len() <= best.effects.len()
        && fit.effects.iter().any(|placed| !best.effects.iter().any(|other| same(placed, other)))
}

/// Returns the probability that an effect is present at its location.
pub(super) fn confidence(weighted: &[Weighted], placed: &Placed) -> f64 {
    let names = |w: &&Weighted| w.effects.iter().any(|other| same(other, placed));
    weighted.iter().filter(names).map(|w| w.probability).sum()
}

/// Returns whether a place is a parameter of the simulator.
pub(super) fn is_parameter(place: &Place) -> bool {
    matches!(place, Place::Parameter(_))
}

#[cfg(test)]
mod tests {
    use plid_simulator::{Description, Input, Output};

    use super::*;
    use crate::in_loop::survey::bare;
    use crate::testing::{random_input, record};

    /// If every second sample is missing, the comparison is that of the others alone.
    #[test]
    fn missing_samples_speak_for_no_explanation() {
        let description = Description::new("s", 100.0, vec![Input::new("u")], vec![Output::new("y")]);
        let noise = random_input(2, 2 * 8 * GROUPS, 2);
        let z = |part: &dyn Fn(&[f64]) -> Vec<f64>, y: Vec<f64>| {
            let simulated =
                |share: f64| -> Vec<Channels> { vec![vec![part(&noise[1]).iter().map(|x| share * x).collect()]] };
            let record = record(vec![part(&noise[0])], vec![y]);
            let setting = bare(&description, &[]).unwrap();
            let problem = Problem::new(vec![record], &simulated(0.3), setting, &[0.1], None);
            let [better, worse] = [0.3, 0.6].map(|share| problem.as_is(Vec::new(), Vec::new(), simulated(share)));
            over_time(&problem, &better, &worse)
        };
        let every_second = |x: &[f64]| -> Vec<f64> { x.iter().step_by(2).copied().collect() };
        let gappy = noise[0].iter().enumerate().map(|(k, y)| if k % 2 == 0 { *y } else { f64::NAN }).collect();
        let (with_gaps, alone) = (z(&|x| x.to_vec(), gappy), z(&every_second, every_second(&noise[0])));
        assert!((with_gaps / alone - 1.0).abs() < 1e-9, "{with_gaps}, alone {alone}");
    }
}
