//! Strong effects are searched for in the weaker records first, and the result is carried to the louder records
//! (continuation in level).
//!
//! A screen by derivatives, and the fits that start from it, cannot find an effect that moves a resonance by more
//! than its width. In weaker records, the effect moves the resonance by less. Once its law is known there, a fit to
//! the louder records starts close to its minimum.

use std::cell::OnceCell;

use crate::case::record::Record;
use crate::fit::candidate::{in_words, same};
use crate::fit::problem::{Fit, Problem};
use crate::fit::refit::{Refit, STEPS, refit};
use crate::noise::NoiseModel;
use crate::search::leading::leading;
use crate::search::price::{Price, material};
use crate::search::rules::Scope;
use crate::search::stage::{SearchStage, polish, whether_sound};
use crate::search::stepwise::{Begin, Search, search};
use crate::search::windows::{Windows, carried, follows};

/// Searches for effects in all records, if necessary in the weaker ones first. The problem of the quick fits is
/// returned, too. `stage` is the first stage of the search; it is filled if it is empty.
pub(crate) fn by_level<'a>(
    problem: &mut Problem,
    noise: &NoiseModel,
    refitted: &Refit,
    scope: &Scope<'_, 'a>,
    stage: &OnceCell<SearchStage<'a>>,
    say: &mut dyn FnMut(String),
) -> (Problem, Search<'a>) {
    let samples = leading(problem, refitted);
    if samples > scope.settings.first_samples {
        say(format!("quick fits to {samples} samples: the gap is small before"));
    }
    let mut quick = problem.head(samples, noise);
    let windows = Windows::choose(&quick, refitted);
    let mut begin = Begin { refit: refitted, windows: None, below: None };
    if let Some(windows) = windows {
        let below = from_below(problem, noise, scope, say);
        (quick.plant, quick.setting.plant) = (problem.plant.clone(), problem.setting.plant.clone());
        quick.strong = true;
        begin.below = below.map(|below| {
            problem.strong = true;
            let finish = |fit| polish(problem, fit);
            // A linear effect acts alike at all levels, so its fit in the weaker records needs no continuation.
            if is_linear(&below) { finish(below) } else { carried(problem, &windows.of(&quick, noise), &below, finish) }
        });
    }
    let strong = windows.filter(|_| begin.below.as_ref().is_none_or(|fit| !follows(problem, &fit.eta, &fit.effects)));
    for problem in [&mut *problem, &mut quick] {
        problem.strong = windows.is_some();
        problem.nuisance.ports_follow = problem.few();
    }
    if let Some(windows) = strong {
        // A linear effect acts alike at all levels, so it is not what the louder records show.
        begin.below = begin.below.filter(|fit| !is_linear(fit));
        say(format!("windows of {} samples, up to {} of each record", windows.samples, windows.each));
        quick = windows.of(&quick, noise);
        begin.windows = Some(noise);
    }
    let found = search(problem, &mut quick, begin, scope, stage, say);
    (quick, found)
}

/// Returns whether all effects of an explanation are linear, so that they act alike at all levels.
fn is_linear(fit: &Fit) -> bool {
    fit.effects.iter().all(|placed| placed.effect.is_linear())
}

/// Returns whether a search has missed the first effect of an earlier pass. That pass, which weights the records by
/// their noise alone, does not begin from a linear cause.
pub(crate) fn has_missed(found: &Fit, earlier: &Fit) -> bool {
    earlier.effects.first().is_some_and(|first| !found.effects.iter().any(|placed| same(placed, first)))
}

/// Searches again from known effects if they explain more than this pass has found. The first of them are taken, as
/// long as each of them explains enough.
pub(crate) fn from_known<'a>(
    problem: &mut Problem,
    quick: &mut Problem,
    [earlier, found]: [&Fit<'a>; 2],
    refitted: &Refit,
    scope: &Scope<'_, 'a>,
    say: &mut dyn FnMut(String),
) -> Option<Search<'a>> {
    let price = Price::new(problem, scope);
    let mut best = refitted.as_fit();
    for count in 1..=earlier.effects.len() {
        let first = Fit { effects: earlier.effects[..count].to_vec(), ..earlier.clone() };
        let enough = |fit: &Fit| {
            price.of(&best) - price.of(fit) > scope.settings.accept_gain && material(problem, scope, &best, fit)
        };
        match whether_sound(problem, polish(problem, first)).filter(enough) {
            Some(fit) => best = fit,
            None => break,
        }
    }
    if best.effects.is_empty() || price.of(&best) + scope.settings.accept_gain > price.of(found) {
        return None;
    }
    say(format!("{} explains more", in_words(&best.effects, &problem.setting.names)));
    let begin = Begin { refit: refitted, windows: None, below: Some(best) };
    Some(search(problem, quick, begin, scope, &OnceCell::new(), say))
}

/// Searches the records without the loudest ones; `None` if all records have about the same level, or if nothing is
/// found. The ports get the scales that were found with the result.
fn from_below<'a>(
    problem: &mut Problem,
    noise: &NoiseModel,
    scope: &Scope<'_, 'a>,
    say: &mut dyn FnMut(String),
) -> Option<Fit<'a>> {
    let driven = |problem: &Problem| problem.records.iter().filter(|r| r.is_driven()).map(Record::level).collect();
    let levels: Vec<f64> = driven(problem);
    let loudest = levels.iter().copied().fold(0.0, f64::max);
    let mut weaker = problem.up_to_level(loudest / scope.settings.level_step);
    let count = driven(&weaker).len();
    if count == 0 {
        return None;
    }
    say(format!("{count} of {} driven records, which are weaker", levels.len()));
    let refitted = refit(&weaker, STEPS);
    let (_, found) = by_level(&mut weaker, noise, &refitted, scope, &OnceCell::new(), say);
    if found.best.effects.is_empty() {
        return None;
    }
    let words = in_words(&found.best.effects, &problem.setting.names);
    say(format!("{words} in the weaker records is carried to all"));
    (problem.plant, problem.setting.plant) = (weaker.plant, weaker.setting.plant);
    Some(found.best)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{Library, Place, Setting};
    use crate::search::rules::Rules;
    use crate::testing::laws::{at, prepared, without};

    /// A cubic spring that an earlier pass has found takes the place of a lag that explains less. A further effect
    /// that the earlier pass has added without need is left out. If this pass has found the spring, too, the search
    /// is not repeated.
    #[test]
    fn what_an_earlier_pass_has_found_is_not_lost() {
        let library = Library::standard();
        let size: fn(&Setting) -> Vec<f64> = |setting| vec![0.02 * setting.force[0] / setting.d_rms[0].powi(3)];
        let mut ready = prepared(&[("cubic-stiffness", size)]);
        let mut quick = ready.problem.head(ready.problem.settings.search.first_samples, &ready.noise);
        let problem = &mut ready.problem;
        let exclude = without(&library, &["cubic-stiffness", "actuator-lag", "sensor-drift"]);
        let rules = Rules { suspects: &[], exclude: &exclude, without: &[] };
        let (settings, names) = (problem.settings.search.clone(), problem.setting.names.clone());
        let scope =
            Scope { library: &library, rules: &rules, settings, names, off: Vec::new(), bold: false, imperfect: true };
        let refitted = refit(problem, STEPS);
        let fit = |problem: &Problem, effects| polish(problem, Fit { effects, ..refitted.as_fit() });
        let spring = at(&library, "cubic-stiffness", Place::Input(0), size(&problem.setting));
        let drift = at(&library, "sensor-drift", Place::Output(0), vec![1e-9]);
        let earlier = fit(problem, vec![spring, drift]);
        let found = fit(problem, vec![at(&library, "actuator-lag", Place::Input(0), vec![400.0])]);
        let mut say = |_: String| {};
        assert!(has_missed(&found, &earlier));
        let again = from_known(problem, &mut quick, [&earlier, &found], &refitted, &scope, &mut say).unwrap();
        let [spring] = again.best.effects.as_slice() else { panic!("one effect") };
        assert_eq!((spring.effect.name(), &spring.place), ("cubic-stiffness", &Place::Input(0)));
        assert!(!has_missed(&again.best, &earlier));
        // A search that has missed the minimum begins again from a known law, although it has found the same effect.
        let missed = Fit { effects: again.best.effects.clone(), ..refitted.as_fit() };
        let known = Fit { effects: again.best.effects.clone(), ..refitted.as_fit() };
        let found = from_known(problem, &mut quick, [&known, &missed], &refitted, &scope, &mut say).unwrap();
        assert!(found.best.cost < 1.01 * again.best.cost, "{} {}", found.best.cost, again.best.cost);
        assert!(from_known(problem, &mut quick, [&known, &again.best], &refitted, &scope, &mut say).is_none());
        assert!(from_known(problem, &mut quick, [&refitted.as_fit(), &missed], &refitted, &scope, &mut say).is_none());
    }
}
