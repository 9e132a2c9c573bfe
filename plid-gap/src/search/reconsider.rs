//! Reconsideration of the effects of an explanation with all others in place.

use rayon::prelude::*;

use crate::effects::{Effect, Side};
use crate::fit::candidate::{Candidate, same};
use crate::fit::problem::{Fit, Placed, Problem};
use crate::search::price::{Price, imitates, material};
use crate::search::stage::{SearchStage, is_blind, polish, whether_sound};

/// The effect that was added last.
pub(super) struct Latest {
    /// The gain of the effect.
    pub gain: f64,
    /// Whether the scales of the ports have changed since.
    pub scaled: bool,
}

/// Reconsiders each effect with all others in place, because the first was chosen while the others were missing. An
/// effect that gained much more than the latest one is kept. The latest effect has already been compared with its
/// rivals, so it is kept, too, unless the explanation has changed since. `gains` are the gains of the effects.
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
        // If effects change the motion strongly or the parameters are few, the fits to the first samples say less
        // about the fits to whole records, and all effects are reconsidered.
        if stays && !problem.few() {
            continue;
        }
        // Whether a change over time follows the time is tested only when it is added.
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

/// Replaces the latest effect by another one whose starting values follow from it, if the other effect explains more.
pub(super) fn related<'a>(
    problem: &Problem,
    best: Fit<'a>,
    price: &Price<'_, 'a>,
    candidates: &mut Vec<Candidate<'a>>,
) -> Fit<'a> {
    let Some((found, others)) = best.effects.split_last() else { return best };
    let starts = |effect: &'a dyn Effect| {
        let starts = effect.starts_from(&problem.setting, &found.place, (found.effect.name(), &found.parameters));
        starts.into_iter().map(move |parameters| Placed { effect, place: found.place.clone(), parameters })
    };
    let new = |placed: &Placed| {
        let there = others.iter().any(|other| same(other, placed));
        price.scope.admits(placed) && !there && !is_blind(&problem.setting, price.scope.rules, placed)
    };
    let may_be_there = |effect: &&dyn Effect| {
        effect.name() != found.effect.name() && effect.places(&problem.setting).contains(&found.place)
    };
    let at = price.scope.library.effects().filter(may_be_there);
    // The linear parameters may have compensated for the error of the effect that was found.
    let etas = [best.eta.clone(), problem.nuisance.as_given(&best.eta)];
    let with = |placed: Placed<'a>| {
        let effects = [others, &[placed]].concat();
        etas.each_ref().map(|eta| Fit { eta: eta.clone(), effects: effects.clone(), ..best.clone() })
    };
    let starts: Vec<Fit> = at.flat_map(starts).filter(new).flat_map(with).collect();
    let fits: Vec<Fit> =
        (starts.into_par_iter()).filter_map(|start| whether_sound(problem, polish(problem, start))).collect();
    candidates.extend(fits.iter().map(|fit| price.candidate(fit)));
    fits.into_iter().fold(best, |best, fit| if price.of(&fit) < price.of(&best) { fit } else { best })
}

/// Replaces each effect by a finer law of the same kind if more than noise is left, and if the finer law explains as
/// much of the residual as a further effect would have to.
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

/// Returns the best fit in which the effect at this index of an explanation is replaced by one that `may` replace it.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{Action, Library, Place, Setting};
    use crate::fit::refit::{STEPS, refit};
    use crate::plant::Plant;
    use crate::prepare::tests::setting_of;
    use crate::prepare::{Known, prepare};
    use crate::search::rules::{Rules, Scope};
    use crate::testing;
    use crate::testing::axis::Axis;

    /// A clearance was found for an axis that moves between soft stops: the stop takes its place.
    #[test]
    fn a_stop_takes_the_place_of_a_clearance() {
        fn stop(d: f64, v: f64) -> f64 {
            let x = d - 0.015;
            if x > 0.0 { -(160.0 * x + 8.0 * v).max(0.0) } else { 0.0 }
        }
        let force = |d, v| stop(d, v) - stop(-d, -v);
        let case = Axis { mass: 1.0, c: 0.8, k: 160.0, force, position: true }.case();
        let problem = prepare(case.model.as_ref().unwrap(), &case.records, &Known::default()).unwrap().problem;
        let library = Library::standard();
        let rules = Rules { suspects: &[], exclude: &[], without: &[] };
        let (settings, names) = (problem.settings.search.clone(), problem.setting.names.clone());
        let scope =
            Scope { library: &library, rules: &rules, settings, names, off: Vec::new(), bold: false, imperfect: false };
        let price = Price::new(&problem, &scope);
        let clearance = library.get("clearance").unwrap();
        let place = clearance.places(&problem.setting).remove(0);
        let effects = vec![Placed { effect: clearance, place, parameters: vec![160.0, 0.01] }];
        let found = polish(&problem, Fit { effects, ..refit(&problem, STEPS).as_fit() });
        let mut candidates = Vec::new();
        let best = related(&problem, found.clone(), &price, &mut candidates);
        let [stop] = best.effects.as_slice() else { panic!("one effect") };
        println!("{:?} at {} after {:?} at {}", stop.parameters, best.cost, found.effects[0].parameters, found.cost);
        assert_eq!(stop.effect.name(), "end-stop");
        assert!((stop.parameters[2] / 0.015 - 1.0).abs() < 0.05, "{:?}", stop.parameters);
        assert!(candidates.len() >= 2 && price.of(&best) + scope.settings.accept_gain < price.of(&found));
    }

    /// Returns the static force of an effect at a displacement, up to the force of a linear spring, which a refit
    /// absorbs.
    fn curve(effect: &dyn Effect, setting: &Setting, place: &Place, parameters: &[f64], d: f64) -> f64 {
        let actions = effect.act(setting, place, parameters);
        let [Action::Force(_, law)] = actions.as_slice() else { panic!("{} is a force", effect.name()) };
        law.force(d, 0.0, &[]) - 2.0 * law.force(0.5 * d, 0.0, &[])
    }

    /// Starting values that follow from another effect give the same force curve, on one side at least.
    #[test]
    fn a_start_that_follows_is_the_same_curve() {
        let model = testing::truss(1);
        let setting = setting_of(&Plant::new(&model).unwrap(), &model);
        let (library, place) = (Library::standard(), Place::Port(0));
        let mut followed = Vec::new();
        for (name, parameters, most) in [
            ("clearance", vec![50.0, 0.1], 0.5),
            ("end-stop", vec![50.0, 0.3, 0.1], 0.5),
            ("one-sided-stop", vec![50.0, 0.3, -0.1], 0.5),
            ("cubic-stiffness", vec![-8.0], 0.2),
            ("gravity-sine", vec![30.0], 0.2),
            ("clearance", vec![-50.0, 0.1], 0.5),
        ] {
            let found = library.get(name).unwrap();
            for effect in library.effects().filter(|effect| effect.name() != name) {
                let starts = effect.starts_from(&setting, &place, (name, &parameters));
                for start in &starts {
                    let same = |d: f64| {
                        let [a, b] = [(found, &parameters), (effect, start)]
                            .map(|(effect, parameters)| curve(effect, &setting, &place, parameters, d));
                        (a - b).abs() <= 0.01 * a.abs() && a != 0.0
                    };
                    assert!(same(most) || same(-most), "{} from {name}: {start:?}", effect.name());
                }
                if !starts.is_empty() {
                    followed.push((name, effect.name()));
                }
            }
        }
        followed.sort_unstable();
        let expected = [
            ("clearance", "backlash"),
            ("clearance", "end-stop"),
            ("clearance", "one-sided-stop"),
            ("cubic-stiffness", "gravity-sine"),
            ("end-stop", "one-sided-stop"),
            ("gravity-sine", "cubic-stiffness"),
            ("one-sided-stop", "end-stop"),
        ];
        assert_eq!(followed, expected);
    }
}
