//! The answer in names, figures and sentences.

pub(crate) mod calibrated;
pub(crate) mod motion;
pub mod predict;
pub(crate) mod range;
pub mod schema;
mod sensor_noise;
pub(crate) mod sentence;
pub mod shape;
pub(crate) mod simulation;
pub(crate) mod statements;
pub(crate) mod whole_delay;
pub(crate) mod words;

pub use range::{Beyond, FittedRange};

use std::collections::BTreeMap;

use statrs::distribution::{ContinuousCDF, StudentsT};

use crate::answer::schema::{Change, Comparison, Gap, Located, NamedEffect, Remainder, RemainderPlace, Value, Where};
use crate::case::Limits;
use crate::effects::{Names, Setting, Side};
use crate::fit::candidate::{Candidate, all_same, in_words, joined, same};
use crate::fit::problem::Placed;
use crate::judge::explained::Explained;
use crate::judge::family::Family;
use crate::judge::gap::{self, Blocks};
use crate::judge::locate::Map;
use crate::judge::separability::{Rival, open};
use crate::judge::shares::Share;
use crate::judge::side::{self, PlaceShare};
use crate::judge::verdict::{Weighted, outside};
use crate::search::stepwise::Search;
use crate::search::stochastic::{Stochastic, cuts, wanders};
use crate::settings::{AnswerSettings, JudgeSettings};

/// Returns the effects of the answer with intervals and confidence. `limits` are those of the simulation's errors.
pub(crate) fn named(
    (explained, limits): (&Explained, &Limits),
    shown: &[&Stochastic],
    weighted: &[Weighted],
    shares: &[Share],
    left: f64,
) -> Vec<NamedEffect> {
    let (ready, best) = (&explained.ready, &explained.found.best);
    let free_shape = explained.free_shape.as_ref().map(|free| free.which);
    let setting = &ready.problem.setting;
    let names = &setting.names;
    let rows = ready.problem.rows() as f64;
    let quantile = StudentsT::new(0.0, 1.0, rows.max(3.0)).map_or(1.96, |t| t.inverse_cdf(0.975));
    let confidence = |placed: &Placed| -> f64 {
        weighted.iter().filter(|w| w.effects.iter().any(|e| same(e, placed))).map(|w| w.probability).sum()
    };
    let problem = &ready.problem;
    let refitted = Setting { plant: problem.nuisance.apply(&problem.plant, &best.eta), ..setting.clone() };
    let mut at = 0;
    let mut named = Vec::new();
    for (which, placed) in best.effects.iter().enumerate() {
        let mut parameters = BTreeMap::new();
        let first = at;
        let own = own_std(placed, setting, limits) * ready.widened.unwrap_or(1.0);
        // The records determine the sum of the simulation's own parameter and the addition to it.
        let sum = |at: usize| quantile * best.covariance[(at, at)].max(0.0).sqrt();
        let half = |at: usize| sum(at).max(quantile * own);
        for (parameter, &value) in placed.effect.parameters(setting).into_iter().zip(&placed.parameters) {
            let unit = setting.unit_of(&parameter, &placed.place);
            parameters.insert(parameter.name, stated(value, half(at), unit));
            at += 1;
        }
        let share = shares.get(which);
        // An effect that closes little of the gap compared with the remainder may merely imitate a part of the
        // remainder.
        let judge = &problem.settings.judge;
        let alone = |share: &Share| ((1.0 - outside(share.left, judge)) / (1.0 - outside(left, judge))).min(1.0);
        let imitated = if ready.widened.is_some() { share.map_or(1.0, alone) } else { 1.0 };
        named.push(NamedEffect {
            effect: placed.effect.name().into(),
            location: placed.place.location(names),
            confidence: confidence(placed) * imitated,
            family: Family::of(placed, weighted).map(|family| family.imitated(imitated)),
            share: share.map(|share| share.value),
            share_ci95: share.map(|share| share.ci95),
            parameters,
            change: changed(placed, setting, &refitted, sum(first)),
            shape_differs: free_shape == Some(which),
        });
    }
    named.extend(shown.iter().map(|shown| of_stochastic(shown, setting, confidence(&shown.placed))));
    named
}

/// Returns a stochastic effect of the answer.
fn of_stochastic(shown: &Stochastic, setting: &Setting, confidence: f64) -> NamedEffect {
    let Stochastic { placed, std, .. } = shown;
    let all = placed.effect.parameters(setting).into_iter().zip(placed.parameters.iter().zip(std));
    // Parameters that follow from raw values are exact up to rounding.
    let half = |value: f64, std: f64| (1.96 * std).max(1e-9 * value.abs());
    NamedEffect {
        effect: placed.effect.name().into(),
        location: placed.place.location(&setting.names),
        confidence,
        family: None,
        share: None,
        share_ci95: None,
        parameters: all
            .map(|(p, (&value, &std))| {
                let unit = setting.unit_of(&p, &placed.place);
                (p.name, stated(value, half(value, std), unit))
            })
            .collect(),
        change: None,
        shape_differs: cuts(placed) || wanders(placed),
    }
}

/// Returns the smallest standard deviation of a mass, a damper or a spring that was added to axes. It combines the
/// error of the simulation's own parameter there and the error of the command's gain, which scales the whole
/// parameter. Where axes are coupled, the poles and gains that the refit changes do not represent every such error.
fn own_std(placed: &Placed, setting: &Setting, limits: &Limits) -> f64 {
    let relative = placed.effect.own_std(limits);
    if relative == 0.0 || !setting.plant.modes.is_empty() {
        return 0.0;
    }
    let change = placed.effect.change(setting, &placed.place, &placed.parameters);
    change.map_or(0.0, |change| (change.from * relative).hypot(change.to * limits.shape / 2.0))
}

/// Returns the parameter of the simulation that an effect changes, with its value as given and its value after the
/// refit and the effect. `half` is half the interval of the effect's parameter, within which the change is taken as
/// linear.
fn changed(placed: &Placed, setting: &Setting, refitted: &Setting, half: f64) -> Option<Change> {
    let &[value] = placed.parameters.as_slice() else { return None };
    let at = |setting: &Setting, parameter: f64| placed.effect.change(setting, &placed.place, &[parameter]);
    let [given, to, end] = [at(setting, value)?, at(refitted, value)?, at(refitted, value + half)?];
    let to = stated(to.to, (end.to - to.to).abs(), setting.unit(&to.unit, &placed.place));
    Some(Change { number: given.number, from: given.from, to })
}

/// Returns a value with its interval, given half the interval's length; without an interval if it is not bounded.
fn stated(value: f64, half: f64, unit: String) -> Value {
    Value { value, ci95: half.is_finite().then_some([value - half, value + half]), unit }
}

/// Returns the location of the gap. `places` are the shares of the residual that each place explains, and `shown` are
/// the stochastic effects of the answer.
pub(crate) fn place(
    before: &Map,
    outputs: &[String],
    places: &[PlaceShare],
    shown: &[&Stochastic],
    (judge, settings): (&JudgeSettings, &AnswerSettings),
) -> Where {
    // An effect that is observed only in quiet records leaves no residual of a free run that a place could explain.
    let quiet = shown.first().filter(|_| places.is_empty()).map(|u| u.placed.effect.side());
    let clear = side::side(places, judge).or(quiet);
    let likely = || places.first().map_or(Side::Structure, |place| place.side);
    let place = whereabouts(Some(clear.unwrap_or_else(likely)), before, outputs, settings);
    Where { places: side::listed(places), side_is_clear: clear.is_some(), ..place }
}

/// Returns the location of a gap according to its map, with this part of the signal path.
pub(crate) fn whereabouts(side: Option<Side>, before: &Map, outputs: &[String], settings: &AnswerSettings) -> Where {
    let mut order: Vec<usize> = (0..before.bands.len()).collect();
    order.sort_by(|&a, &b| before.bands[b].value.total_cmp(&before.bands[a].value));
    order.truncate(4);
    order.retain(|&b| before.bands[b].value > settings.listed_band);
    let by_name = || outputs.iter().cloned().zip(&before.outputs);
    Where {
        side,
        side_is_clear: false,
        places: Vec::new(),
        channels: by_name().map(|(name, share)| (name, share.value)).collect(),
        bands_hz: order.iter().map(|&b| [before.edges[b], before.edges[b + 1], before.bands[b].value]).collect(),
        time: before.stretches.iter().map(|share| share.value).collect(),
        level_slope: before.slope.map(|slope| slope.value),
        channels_ci95: by_name().map(|(name, share)| (name, share.ci95)).collect(),
        bands_ci95: order.iter().map(|&b| before.bands[b].ci95).collect(),
        time_ci95: before.stretches.iter().map(|share| share.ci95).collect(),
        level_slope_ci95: before.slope.map(|slope| slope.ci95),
        levels: before.levels.clone(),
    }
}

/// Returns the best explanation with those that these records cannot separate from it, the most probable first.
pub(crate) fn classes(explained: &Explained, rivals: &[Rival]) -> Vec<Vec<String>> {
    let Explained { ready, found, .. } = explained;
    let (best, problem) = (&found.best.effects, &ready.problem);
    let open = open(rivals, best, &problem.settings.judge).map(|rival| rival.effects.as_slice());
    let mut class: Vec<&[Placed]> = open.chain([best.as_slice()]).collect();
    if class.len() < 2 {
        return Vec::new();
    }
    let place =
        |effects: &[Placed]| found.candidates.iter().position(|candidate| all_same(&candidate.effects, effects));
    class.sort_by_key(|effects| place(effects));
    vec![class.into_iter().map(|effects| joined(effects, &problem.setting.names, "@")).collect()]
}

/// States the explanations that cannot be separated from the best one.
pub(crate) fn others(explained: &Explained, rivals: &[Rival]) -> Option<String> {
    let problem = &explained.ready.problem;
    let open = open(rivals, &explained.found.best.effects, &problem.settings.judge);
    let texts: Vec<String> = open.map(|rival| in_words(&rival.effects, &problem.setting.names)).collect();
    (!texts.is_empty()).then(|| texts.join(", nor from "))
}

/// Returns the separability of the best explanation from others on the records: first the best explanation itself,
/// then the explanations with which it was compared after the fits, and then the remaining entries of the first
/// screen.
pub(crate) fn comparisons(found: &Search, best: &[Placed], rivals: &[Rival], names: &Names) -> Vec<Comparison> {
    let entries = found.stages.first().map_or(&[][..], Vec::as_slice);
    let overlap = found.overlap.as_ref();
    let leading = overlap.map_or(0, |overlap| overlap.absorbed.len());
    let place = |placed: &Placed| entries[..leading].iter().position(|entry| same(&entry.placed, placed));
    // The effect that the others would replace.
    let reference = if best.is_empty() { (leading > 0).then_some(0) } else { best.iter().find_map(place) };
    let before = |entry: Option<usize>, explanation: String| Comparison {
        explanation,
        absorbed: overlap.zip(entry).map(|(overlap, entry)| overlap.absorbed[entry]),
        cosine: overlap.zip(reference).zip(entry).map(|((overlap, from), entry)| overlap.cosine[(from, entry)]),
        expected_before: overlap.zip(reference).zip(entry).map(|((overlap, from), to)| overlap.expected[(from, to)]),
        expected: None,
        realised: None,
    };
    let mut rows = Vec::new();
    if !best.is_empty() {
        let own = before(reference, joined(best, names, "@"));
        rows.push(Comparison { expected: Some(0.0), realised: Some(0.0), ..own });
    }
    // The entry that replaces the reference in a rival.
    let replacing = |rival: &Rival| {
        let replaced = &entries[reference?].placed;
        let kept = |placed: &Placed| best.iter().any(|b| !same(b, replaced) && same(b, placed));
        let new: Vec<&Placed> = rival.effects.iter().filter(|placed| !kept(placed)).collect();
        if let [one] = new.as_slice() { place(one) } else { None }
    };
    let mut listed: Vec<usize> = best.iter().filter_map(place).collect();
    for rival in rivals {
        let entry = replacing(rival);
        listed.extend(entry);
        let row = before(entry, joined(&rival.effects, names, "@"));
        rows.push(Comparison { expected: Some(rival.expected), realised: Some(rival.realised), ..row });
    }
    let fitted = |entry: usize| fitted_in_place(found, best, &entries[reference?].placed, &entries[entry].placed);
    let own = found.candidates.iter().find(|candidate| !best.is_empty() && all_same(&candidate.effects, best));
    for entry in (0..leading).filter(|entry| !listed.contains(entry)) {
        let candidate = fitted(entry);
        let effects = candidate.map_or(std::slice::from_ref(&entries[entry].placed), |candidate| &candidate.effects);
        let realised = candidate.zip(own).map(|(candidate, own)| 0.5 * (candidate.cost - own.cost));
        rows.push(Comparison { realised, ..before(Some(entry), joined(effects, names, "@")) });
    }
    rows
}

/// Returns the candidate in which `entry` replaces `replaced` in the best explanation, if this candidate was fitted.
/// Its fit was too poor for a further comparison.
fn fitted_in_place<'f, 'a>(
    found: &'f Search<'a>,
    best: &[Placed],
    replaced: &Placed,
    entry: &Placed,
) -> Option<&'f Candidate<'a>> {
    let kept = |placed: &Placed| best.iter().any(|b| !same(b, replaced) && same(b, placed));
    let is = |effects: &[Placed]| {
        effects.len() == best.len()
            && effects.iter().any(|placed| same(placed, entry))
            && effects.iter().all(|placed| same(placed, entry) || kept(placed))
    };
    found.candidates.iter().find(|candidate| is(&candidate.effects))
}

/// Returns the remainder of the best explanation: its size on the records that are opened after all fits, and its
/// location on the fitted ones. `repeats` is the share of the remainder's power that is the same in every period.
pub(crate) fn remainder(
    explained: &Explained,
    gap: &Gap,
    (after, with): (&Map, &Blocks),
    repeats: Option<f64>,
    material: f64,
) -> Remainder {
    let names = &explained.ready.problem.setting.names;
    let found = &explained.found;
    let floor = gap.noise_floor;
    let beyond = |gap: f64| (gap * gap - floor * floor).max(0.0);
    // If the residual counts as noise, a further cause is no more probable than something outside the vocabulary.
    let most = explained.unpredicted.as_ref().map_or(1.0, |_| explained.judged.unknown);
    let further = |often: f64| often.min(most);
    let place = whereabouts(None, after, &names.outputs, &explained.ready.problem.settings.answer);
    let best = &found.best.effects;
    let last = found.stages.last().map_or(&[][..], Vec::as_slice);
    let more = last.iter().filter(|entry| {
        entry.gain > explained.ready.problem.settings.judge.next_gain
            && !best.iter().any(|placed| same(placed, &entry.placed))
    });
    Remainder {
        gap: gap.with_effect,
        noise: floor,
        noise_unseen: !explained.level.seen && explained.unpredicted.is_none(),
        share_of_gap: if beyond(gap.as_given) > 0.0 {
            (beyond(gap.with_effect) / beyond(gap.as_given)).min(1.0)
        } else {
            0.0
        },
        further_cause: further(gap::how_often([with], |[with]| beyond(with) > material * material)),
        material,
        repeats,
        place: RemainderPlace { channels: place.channels, bands_hz: place.bands_hz },
        nearest: more
            .take(MOST_NEAREST)
            .map(|entry| Located {
                effect: entry.placed.effect.name().into(),
                location: entry.placed.place.location(names),
            })
            .collect(),
    }
}

/// Largest number of entries of a screen that are named as nearest to a remainder: more would not be read.
pub(crate) const MOST_NEAREST: usize = 3;

#[cfg(test)]
mod tests {
    use plid_model::Model;

    use super::*;
    use crate::diagnose::diagnose;
    use crate::effects::Library;
    use crate::plant::Plant;
    use crate::prepare::tests::setting_of;
    use crate::testing::axis::Axis;
    use crate::testing::{case, truss, truss_with};

    /// An unknown name is an error with the nearest known one.
    #[test]
    fn names_that_do_not_exist_are_refused() {
        let ask = |exclude: &str| {
            let mut case = case(&truss(1), &truss(1));
            case.config.exclude = vec![exclude.into()];
            diagnose(&case, &Library::standard(), &mut |_| {})
        };
        for (wrong, right) in [("cubic-stifness", "cubic-stiffness"), ("input:u11", "input:u1")] {
            let message = ask(wrong).err().unwrap().to_string();
            assert!(message.contains("exclude") && message.contains(&format!("did you mean `{right}`")), "{message}");
        }
        assert!(ask("mode:123.4").is_ok());
    }

    /// An addition to a servo's inertia, damper or spring is known no better than the inertia, damper or spring
    /// itself. On a structure, the modes of the refit contain the error.
    #[test]
    fn an_added_number_is_known_no_better_than_the_simulations_own() {
        let library = Library::standard();
        let servo = Axis { mass: 2.0, c: 12.0, k: 8.0, force: |_, _| 0.0, position: true }.simulation();
        let std = |model: &Model, name: &str| {
            let setting = setting_of(&Plant::new(model).unwrap(), model);
            let effect = library.get(name).unwrap();
            let place = effect.places(&setting).remove(0);
            own_std(&Placed { effect, place, parameters: vec![0.1] }, &setting, &Limits::default())
        };
        for (name, own, relative) in
            [("added-mass", 2.0, 0.002), ("added-damping", 12.0, 0.05), ("added-stiffness", 8.0, 0.002)]
        {
            // The gain of the command is known to 1 %.
            let expected = f64::hypot(own * relative, (own + 0.1) * 0.01);
            assert!((std(&servo, name) / expected - 1.0).abs() < 1e-3, "{name}: {} {expected}", std(&servo, name));
            assert_eq!(std(&truss(1), name), 0.0);
        }
        assert_eq!(std(&servo, "actuator-gain"), 0.0);
    }

    /// For a frequency, a damping ratio and a factor, the answer states the parameter of the simulation that changes,
    /// with its old and its new value.
    #[test]
    fn numbers_of_the_simulation_are_said() {
        let real = truss(1);
        let (hz, zeta) = crate::testing::MODES[1];
        let frequency = (truss_with(1, |modes, _, _| modes[1].0 = 1.02 * hz), "frequency of the mode at 139.7 Hz", hz);
        let damping =
            (truss_with(1, |modes, _, _| modes[1].1 = 2.0 * zeta), "damping ratio of the mode at 137.0 Hz", zeta);
        let factor = (truss_with(1, |_, _, shapes| shapes.row_mut(1).scale_mut(1.25)), "factor of output y2", 0.8);
        for (sim, number, truth) in [frequency, damping, factor] {
            let outcome = diagnose(&case(&sim, &real), &Library::standard(), &mut |_| {}).unwrap();
            let [named] = outcome.diagnosis.effects.as_slice() else { panic!("{}", outcome.diagnosis.sentence) };
            let change = named.change.as_ref().unwrap();
            assert_eq!(change.number, number);
            let [low, high] = change.to.ci95.unwrap();
            assert!(
                low < truth && truth < high && (change.to.value / truth - 1.0).abs() < 0.02,
                "{change}, not {truth}"
            );
            assert!((change.from / truth - 1.0).abs() > 0.015, "{change}");
        }
    }
}
