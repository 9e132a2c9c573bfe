//! Effects of an explanation that are reconsidered with all others in place.

use crate::effects::{Effect, Side};
use crate::fit::candidate::{Candidate, same};
use crate::fit::problem::{Fit, Placed, Problem};
use crate::search::price::{Price, imitates, material};
use crate::search::stage::SearchStage;

/// The effect that was added last.
pub(super) struct Latest {
    /// Its gain.
    pub gain: f64,
    /// Whether the scales of the ports have changed since.
    pub scaled: bool,
}

/// Reconsiders the effects with all others in place: the first was chosen while the others were missing. An effect that
/// gained far more than the latest one is kept. The latest one has been compared with its rivals, unless the
/// explanation has changed since. `gains` are those of the effects.
pub(super) fn question<'a>(
    problem: &Problem,
    quick: &Problem,
    mut best: Fit<'a>,
    latest: &Latest,
    gains: &mut Vec<f64>,
    price: &Price<'_, 'a>,
    candidates: &mut Vec<Candidate<'a>>,
) -> Fit<'a> {
    let asked = best.effects.clone();
    let mut changed = latest.scaled;
    for (number, asked_now) in asked.iter().enumerate() {
        let Some(place) = best.effects.iter().position(|placed| same(placed, asked_now)) else { continue };
        let is_latest = number + 1 == asked.len();
        let stays = is_latest && !changed || gains[place] > price.scope.settings.questioned * latest.gain;
        // Where effects move much, the fits to the first samples say less about those to whole records.
        if stays && !problem.few() {
            continue;
        }
        // Whether a change over time is one is only asked where it is added.
        let may = |placed: &Placed| {
            !same(asked_now, placed) && price.scope.admits(placed) && placed.effect.side() != Side::Time
        };
        let top = replaced(problem, quick, &best, place, &may, price, candidates);
        if let Some(top) = top.filter(|top| price.of(top) < price.of(&best)) {
            best = top;
            changed = true;
            let gain = gains.remove(place);
            gains.push(gain);
        }
    }
    best
}

/// Replaces each effect by a finer law of the same kind if more than noise is left, and if the finer law explains as
/// much of that as a further effect would have to.
pub(super) fn refined<'a>(
    problem: &Problem,
    quick: &Problem,
    mut best: Fit<'a>,
    price: &Price<'_, 'a>,
    candidates: &mut Vec<Candidate<'a>>,
) -> Fit<'a> {
    let scope = price.scope;
    if !imitates(&best, price) {
        return best;
    }
    for place in 0..best.effects.len() {
        let coarse = best.effects[place].clone();
        let refines = |effect: &dyn Effect| effect.refines() == Some(coarse.effect.name());
        if !scope.library.effects().any(refines) {
            continue;
        }
        let may = |placed: &Placed| refines(placed.effect) && placed.place == coarse.place && scope.allows(placed);
        let top = replaced(problem, quick, &best, place, &may, price, candidates);
        let pays = |top: &Fit| price.of(&best) - price.of(top) > scope.settings.accept_gain;
        if let Some(top) = top.filter(|top| pays(top) && material(problem, scope, &best, top)) {
            best = top;
        }
    }
    best
}

/// Returns the best fit in which the effect at this place of an explanation is replaced by one that `may` take it.
fn replaced<'a>(
    problem: &Problem,
    quick: &Problem,
    best: &Fit<'a>,
    place: usize,
    may: &(dyn Fn(&Placed) -> bool + Sync),
    price: &Price<'_, 'a>,
    candidates: &mut Vec<Candidate<'a>>,
) -> Option<Fit<'a>> {
    let settings = &price.scope.settings;
    let mut others = best.effects.clone();
    others.remove(place);
    let there = |placed: &Placed| others.iter().any(|other| same(other, placed)) || !may(placed);
    let without = Fit { effects: others.clone(), ..best.clone() };
    let counts = [settings.fitted / 2, settings.polished / 2];
    // Windows do not give a fair comparison, because each has its own initial state.
    let incumbent = (!problem.few()).then_some(&best.effects[place]);
    let searched = SearchStage::new(problem, quick, &without, incumbent, &there, price, counts);
    let (_, fits) = searched.without(problem, quick, &there, price);
    candidates.extend(fits.iter().map(|fit| price.candidate(fit)));
    fits.into_iter().min_by(|a, b| price.of(a).total_cmp(&price.of(b)))
}
