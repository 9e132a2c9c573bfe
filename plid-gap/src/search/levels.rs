//! Strong effects are searched in the weaker records first, and what is found there is carried up (continuation in
//! level).
//!
//! An effect that moves a resonance by more than its width hides from a screen of derivatives and from fits that start
//! from them. In weaker records it moves the resonance by less. Once its law is known there, a fit to the louder
//! records starts close to its minimum.

use std::cell::OnceCell;

use crate::case::record::Record;
use crate::fit::candidate::in_words;
use crate::fit::problem::{Fit, Problem};
use crate::fit::refit::{Refit, STEPS, refit};
use crate::noise::NoiseModel;
use crate::search::leading::leading;
use crate::search::rules::Scope;
use crate::search::stage::{SearchStage, polish};
use crate::search::stepwise::{Begin, Search, search};
use crate::search::windows::{Windows, follows};

/// Searches on all records. Returns the problem of the quick fits, too. `stage` is the first stage of the search; it is
/// filled if it is empty.
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
    if windows.is_some() {
        begin.below = from_below(problem, noise, scope, say);
        (quick.plant, quick.setting.plant) = (problem.plant.clone(), problem.setting.plant.clone());
    }
    let strong = windows.filter(|_| begin.below.as_ref().is_none_or(|fit| !follows(problem, &fit.eta, &fit.effects)));
    for problem in [&mut *problem, &mut quick] {
        problem.strong = windows.is_some();
        problem.nuisance.ports_follow = problem.few();
    }
    if let Some(Windows { samples, each }) = strong {
        say(format!("windows of {samples} samples, up to {each} of each record"));
        quick = quick.windows(samples, each, noise);
        begin.windows = Some(noise);
    }
    let found = search(problem, &mut quick, begin, scope, stage, say);
    (quick, found)
}

/// Searches in the records without the loudest, and fits what is found there to all of them; `None` if all have about
/// one level, or if nothing is found. The ports get the scales that were found with it.
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
    problem.strong = true;
    Some(polish(problem, found.best))
}
